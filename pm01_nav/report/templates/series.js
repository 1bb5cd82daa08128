// Plots of what happened over time, with a line at the present moment.

const PLOT = { left: 46, right: 10, top: 8, bottom: 18 };

// Lines of one plot: name, colour, values at times 0, dt, 2 dt, ... or from dt on.
function seriesOf(replay, cumulative) {
  const { about } = replay;
  const terms = about.rewards.map((name, k) => ({
    name: name.replaceAll("_", " "),
    color: `--e${k % 10}`,
    dashed: k >= 10,
    values: perStep(replay[`reward${k}`], cumulative),
  }));
  const column = (values, k) => values.filter((_, index) => index % 2 === k);
  return {
    reward: terms.filter(({ values }) => values.some((value) => Math.abs(value) > 1e-6)),
    speed: [
      { name: "v [m/s]", color: "--e0", values: column(replay.twist, 0) },
      { name: "w [rad/s]", color: "--e1", values: column(replay.twist, 1) },
    ],
    clearance: [{ name: "clearance [m]", color: "--e3", values: replay.clearance }],
  };
}

// A step's reward belongs to its end; at the start there is none yet.
function perStep(values, cumulative) {
  const result = new Float32Array(values.length + 1);
  values.forEach((value, k) => {
    result[k + 1] = cumulative ? result[k] + value : value;
  });
  return result;
}

function drawSeries(context, width, height, lines, duration, dt, time, colors) {
  // What the last step brings (the goal's reward) may be far beyond the rest; it leaves the plot.
  const [low, high] = rangeOf(lines.flatMap(({ values }) => [...values.slice(0, -1)]));
  const right = width - PLOT.right;
  const bottom = height - PLOT.bottom;
  const x = (seconds) => PLOT.left + (seconds / (duration || 1)) * (right - PLOT.left);
  const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - PLOT.top);
  context.clearRect(0, 0, width, height);
  drawAxes(context, x, y, { low, high, right, bottom, duration }, colors);
  context.save();
  context.beginPath();
  context.rect(PLOT.left, PLOT.top, right - PLOT.left + 2, bottom - PLOT.top);
  context.clip();
  for (const { color, values, dashed } of lines) {
    context.strokeStyle = colors[color];
    context.lineWidth = 1.6;
    context.setLineDash(dashed ? [5, 3] : []);
    context.beginPath();
    let pen = "moveTo";
    values.forEach((value, k) => {
      if (Number.isNaN(value)) pen = "moveTo";
      else {
        context[pen](x(k * dt), y(value));
        pen = "lineTo";
      }
    });
    context.stroke();
  }
  context.restore();
  drawRule(context, x(time), PLOT.top, x(time), bottom, colors.ink);
}

function drawAxes(context, x, y, { low, high, right, bottom, duration }, colors) {
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = colors.soft;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const value of ticks(low, high, 4)) {
    drawRule(context, PLOT.left, y(value), right, y(value), colors.metres);
    context.fillText(label(value), PLOT.left - 6, y(value));
  }
  if (low < 0 && high > 0) drawRule(context, PLOT.left, y(0), right, y(0), colors.edge);
  context.textBaseline = "alphabetic";
  for (const seconds of ticks(0, duration, 6)) {
    context.textAlign = x(seconds) > right - 12 ? "right" : "center";
    context.fillText(`${label(seconds)} s`, x(seconds), bottom + 14);
  }
}

function drawRule(context, x1, y1, x2, y2, color) {
  context.strokeStyle = color;
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(x1, y1);
  context.lineTo(x2, y2);
  context.stroke();
}

function rangeOf(values) {
  const low = values.reduce((least, value) => (value < least ? value : least), 0);
  const high = values.reduce((most, value) => (value > most ? value : most), 0);
  const margin = 0.05 * (high - low) || 0.5;
  return [low < 0 ? low - margin : 0, high > 0 ? high + margin : low < 0 ? 0 : margin];
}

function ticks(low, high, count) {
  if (!(high > low)) return [low];
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].find((factor) => factor * power >= rough) * power;
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}

const label = (value) => String(Number(value.toPrecision(3))).replace("-", "\u2212");
