// What moves: robot, lidar, movers, and the way driven so far.

// The state at a time between two steps: straight from one to the next, the scan as last measured.
function stateAt(replay, time) {
  const last = replay.yaw.length - 1;
  const exact = Math.min(Math.max(time / replay.about.control_dt, 0), last);
  const step = Math.min(Math.floor(exact + 1e-6), last);
  const next = Math.min(step + 1, last);
  const part = Math.max(exact - step, 0);
  const mix = (values, width, k) =>
    values[step * width + k] * (1 - part) + values[next * width + k] * part;
  const turn = replay.yaw[next] - replay.yaw[step];
  return {
    step,
    time: exact * replay.about.control_dt,
    x: mix(replay.position, 2, 0),
    y: mix(replay.position, 2, 1),
    yaw: replay.yaw[step] + part * Math.atan2(Math.sin(turn), Math.cos(turn)),
    speed: mix(replay.twist, 2, 0),
    turning: mix(replay.twist, 2, 1),
    clearance: mix(replay.clearance, 1, 0),
    mover: (k) => [mix(replay.movers, movers(replay) * 2, 2 * k), mix(replay.movers, movers(replay) * 2, 2 * k + 1)],
    over: exact >= last,
  };
}

const movers = (replay) => replay.arrays.movers.shape[1];

function drawScene(context, view, replay, state, colors, showLidar) {
  drawGoal(context, view, replay, colors);
  drawTrail(context, view, replay, state, colors);
  if (showLidar) drawLidar(context, view, replay, state, colors);
  drawMovers(context, view, replay, state, colors);
  drawRobot(context, view, replay, state, colors);
}

function drawGoal(context, view, { goal: [x, y], about }, colors) {
  context.strokeStyle = context.fillStyle = colors.goal;
  context.lineWidth = 2;
  disc(context, view, x, y, Math.max(view.scale * about.goal_radius, 5));
  context.globalAlpha = 0.18;
  context.fill();
  context.globalAlpha = 1;
  context.stroke();
  disc(context, view, x, y, 2.5);
  context.fill();
}

function drawTrail(context, view, replay, state, colors) {
  tracePath(context, view, replay.position.subarray(0, 2 * state.step + 2));
  context.lineTo(view.x(state.x), view.y(state.y));
  context.strokeStyle = colors.robot;
  context.lineWidth = 2.5;
  context.lineJoin = "round";
  context.globalAlpha = 0.55;
  context.stroke();
  context.globalAlpha = 1;
}

function drawLidar(context, view, replay, state, colors) {
  const { angles, scan, position, scan_every: every } = replay;
  const lidar = replay.about.robot.lidar;
  // A scan is drawn from where it was measured, so that its returns lie on the walls.
  const row = Math.floor(state.step / every);
  const yaw = replay.yaw[row * every];
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  const x = position[2 * row * every] + cos * lidar.x - sin * lidar.y;
  const y = position[2 * row * every + 1] + sin * lidar.x + cos * lidar.y;
  context.strokeStyle = context.fillStyle = colors.lidar;
  context.lineWidth = 1;
  angles.forEach((angle, beam) => {
    const measured = scan[row * angles.length + beam];
    const range = Number.isNaN(measured) ? lidar.range_max : measured;
    const end = [x + range * Math.cos(angle + yaw), y + range * Math.sin(angle + yaw)];
    context.globalAlpha = Number.isNaN(measured) ? 0.1 : 0.28;
    tracePath(context, view, [x, y, ...end]);
    context.stroke();
    if (Number.isNaN(measured)) return;
    context.globalAlpha = 1;
    disc(context, view, ...end, 1.6);
    context.fill();
  });
  context.globalAlpha = 1;
}

function drawMovers(context, view, replay, state, colors) {
  const count = movers(replay);
  context.fillStyle = colors.mover;
  for (let k = 0; k < count; k++) {
    const radius = replay.mover_radius[state.step * count + k];
    disc(context, view, ...state.mover(k), view.scale * radius);
    context.fill();
  }
}

function drawRobot(context, view, replay, state, colors) {
  const { footprint } = replay.about.robot;
  const lost = state.over && replay.about.outcome !== "success";
  const vertices = footprint.vertices ?? [];
  const round = footprint.shape === "circle";
  const reach = round ? footprint.radius : Math.min(...vertices.map(([x, y]) => Math.hypot(x, y)));
  context.save();
  context.translate(view.x(state.x), view.y(state.y));
  context.scale(view.scale, -view.scale);
  context.rotate(state.yaw);
  context.fillStyle = lost ? colors.collision : colors.robot;
  context.beginPath();
  if (round) context.arc(0, 0, reach, 0, TAU);
  else vertices.forEach(([x, y]) => context.lineTo(x, y));
  context.closePath();
  context.fill();
  context.lineWidth = 1.25 / view.scale;
  context.strokeStyle = colors.ink;
  context.stroke();
  // The mark points where the robot heads.
  context.fillStyle = "#fff";
  context.beginPath();
  for (const [x, y] of [[0.7, 0], [-0.5, 0.48], [-0.25, 0], [-0.5, -0.48]]) {
    context.lineTo(x * reach, y * reach);
  }
  context.fill();
  context.restore();
}
