// The dialog that plays a stored episode. The address says which: #suite/entry/episode.

const dialog = document.querySelector("#player");
const part = (name) => dialog.querySelector(`[data-part="${name}"]`);
const COLORS = ["floor", "metres", "obstacle", "edge", "wall", "goal", "robot", "lidar", "mover",
  "collision", "ink", "soft"];
const SERIES = ["reward", "speed", "clearance"];

// What is shown now; read by tests and measurements as well.
const player = { key: "", replay: null, time: 0, playing: false, speed: 1, lidar: true };
window.pm01Player = player;

let colors = {};
let stillWorld = null;
let series = null;
let lastFrame = 0;

const duration = () => (player.replay.yaw.length - 1) * player.replay.about.control_dt;

async function openReplay(key) {
  const source = [...document.querySelectorAll("script[data-replay]")]
    .find((script) => script.dataset.replay === key);
  if (!source) return;
  const replay = await unpackReplay(source.textContent.trim());
  // Somebody may have chosen another one meanwhile.
  if (location.hash.slice(1) !== key) return;
  Object.assign(player, { key, replay, time: 0, playing: false });
  describe();
  if (!dialog.open) dialog.showModal();
  dialog.scrollTop = 0;
  resize();
  setPlaying(!matchMedia("(prefers-reduced-motion: reduce)").matches);
}

function describe() {
  const { about, suite, entry, episode } = player.replay;
  part("title").textContent = `${entry} on ${suite}`;
  part("episode").textContent = `episode ${episode}`;
  part("outcome").textContent = about.outcome;
  part("outcome").className = `outcome ${about.outcome}`;
  part("reason").textContent = about.reason;
  part("scrub").max = duration();
  part("scrub").step = about.control_dt;
  part("world").setAttribute("aria-label", `Replay of ${entry} on ${suite}: ${about.outcome}`);
  chooseSeries();
}

function chooseSeries() {
  series = seriesOf(player.replay, part("cumulative").checked);
  for (const name of SERIES) {
    part(`${name}-legend`).replaceChildren(...series[name].map((line) => {
      const item = document.createElement("li");
      item.textContent = line.name;
      item.style.setProperty("--c", `var(${line.color})`);
      item.classList.toggle("dashed", Boolean(line.dashed));
      const value = document.createElement("b");
      item.append(value);
      line.show = value;
      return item;
    }));
  }
}

// A canvas is as sharp as the screen; sizes are in CSS pixels.
function sharpen(canvas) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { canvas, context, width, height };
}

let surfaces = {};

function resize() {
  if (!player.replay || !dialog.open) return;
  const style = getComputedStyle(document.documentElement);
  const names = [...COLORS, ...Array.from({ length: 10 }, (_, k) => `e${k}`)];
  colors = {};
  for (const name of names) {
    colors[name] = colors[`--${name}`] = style.getPropertyValue(`--${name}`).trim();
  }
  const [left, bottom, right, top] = player.replay.bounds;
  part("world").style.aspectRatio = Math.min(Math.max((right - left) / (top - bottom), 0.6), 2.2);
  for (const name of ["world", ...SERIES]) surfaces[name] = sharpen(part(name));
  const { canvas, width, height } = surfaces.world;
  surfaces.view = fitView(player.replay.bounds, width, height);
  stillWorld = document.createElement("canvas");
  Object.assign(stillWorld, { width: canvas.width, height: canvas.height });
  const context = stillWorld.getContext("2d");
  context.scale(canvas.width / width, canvas.height / height);
  drawWorld(context, surfaces.view, player.replay, colors);
  draw();
}

function draw() {
  const { context, width, height } = surfaces.world;
  const state = stateAt(player.replay, player.time);
  context.clearRect(0, 0, width, height);
  context.drawImage(stillWorld, 0, 0, width, height);
  drawScene(context, surfaces.view, player.replay, state, colors, player.lidar);
  const dt = player.replay.about.control_dt;
  for (const name of SERIES) {
    const plot = surfaces[name];
    drawSeries(plot.context, plot.width, plot.height, series[name], duration(), dt, state.time, colors);
    for (const { show, values } of series[name]) show.textContent = fixed(values[state.step]);
  }
  player.state = state;
  player.firstDrawn ??= performance.now();
  part("scrub").value = state.time;
  part("time").textContent = `${state.time.toFixed(1)} / ${duration().toFixed(1)} s`;
}

const fixed = (value) => (Number.isNaN(value) ? "\u2013" : value.toFixed(2).replace("-", "\u2212"));

function setPlaying(playing) {
  if (playing && player.time >= duration()) player.time = 0;
  player.playing = playing;
  part("play").textContent = playing ? "Pause" : "Play";
  if (playing) {
    lastFrame = performance.now();
    requestAnimationFrame(advance);
  }
}

function advance(now) {
  if (!player.playing || !dialog.open) return;
  player.time += Math.max(now - lastFrame, 0) / 1000 * player.speed;
  lastFrame = now;
  if (player.time >= duration()) {
    player.time = duration();
    setPlaying(false);
  }
  draw();
  if (player.playing) requestAnimationFrame(advance);
}

function seek(time) {
  setPlaying(false);
  player.time = Math.min(Math.max(time, 0), duration());
  draw();
}

// The episodes that can be chosen, in the order of the page.
function neighbour(offset) {
  const links = [...document.querySelectorAll("a[data-key]")].map((link) => link.dataset.key);
  const next = links[links.indexOf(player.key) + offset];
  if (next) location.hash = next;
}

function onKey(event) {
  const typing = event.target.matches("select, input[type=checkbox]");
  const step = player.replay.about.control_dt * (event.shiftKey ? 10 : 1);
  const actions = {
    " ": () => setPlaying(!player.playing),
    ArrowLeft: () => seek(player.time - step),
    ArrowRight: () => seek(player.time + step),
    Home: () => seek(0),
    End: () => seek(duration()),
    n: () => neighbour(1),
    p: () => neighbour(-1),
  };
  const action = actions[event.key];
  if (!action || typing || event.ctrlKey || event.metaKey || event.altKey) return;
  // A focused button would take the space bar for a click of its own.
  if (event.key === " " && event.target.matches("button")) return;
  event.preventDefault();
  action();
}

function seekOnPlot(event) {
  if (event.type === "pointermove" && !(event.buttons & 1)) return;
  const { width } = surfaces.speed;
  const share = (event.offsetX - PLOT.left) / (width - PLOT.left - PLOT.right);
  seek(share * duration());
}

function followAddress() {
  const key = location.hash.slice(1);
  if (key.split("/").length === 3) openReplay(key);
  else if (dialog.open) dialog.close();
}

function closed() {
  player.playing = false;
  const scroll = [window.scrollX, window.scrollY];
  if (location.hash.split("/").length === 3) {
    history.replaceState(null, "", location.href.split("#")[0]);
  }
  window.scrollTo(...scroll);
}

part("play").addEventListener("click", () => setPlaying(!player.playing));
part("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
part("rate").addEventListener("change", (event) => { player.speed = Number(event.target.value); });
part("cumulative").addEventListener("change", () => { chooseSeries(); draw(); });
part("lidar").addEventListener("change", (event) => { player.lidar = event.target.checked; draw(); });
part("previous").addEventListener("click", () => neighbour(-1));
part("next").addEventListener("click", () => neighbour(1));
part("close").addEventListener("click", () => dialog.close());
for (const name of SERIES) {
  part(name).addEventListener("pointerdown", seekOnPlot);
  part(name).addEventListener("pointermove", seekOnPlot);
}
dialog.addEventListener("keydown", onKey);
dialog.addEventListener("close", closed);
window.addEventListener("resize", resize);
window.addEventListener("hashchange", followAddress);
