// What stands still: floor, grid, polygons, discs, walls.

const TAU = 2 * Math.PI;

// Where the world lies on a canvas of width x height [px], y up.
function fitView([left, bottom, right, top], width, height, margin = 10) {
  const across = Math.max(right - left, 1e-3);
  const up = Math.max(top - bottom, 1e-3);
  const scale = Math.min((width - 2 * margin) / across, (height - 2 * margin) / up);
  const x = (width - scale * across) / 2 - scale * left;
  const y = (height + scale * up) / 2 + scale * bottom;
  return { scale, x: (east) => x + scale * east, y: (north) => y - scale * north };
}

function drawWorld(context, view, replay, colors) {
  drawFloor(context, view, replay.bounds, colors);
  drawGrid(context, view, replay.grid, colors);
  context.fillStyle = colors.obstacle;
  context.strokeStyle = colors.edge;
  context.lineWidth = 1.25;
  for (const corners of polygonsOf(replay)) {
    tracePath(context, view, corners);
    context.closePath();
    context.fill();
    context.stroke();
  }
  for (let k = 0; k < replay.discs.length; k += 3) {
    disc(context, view, replay.discs[k], replay.discs[k + 1], view.scale * replay.discs[k + 2]);
    context.fill();
    context.stroke();
  }
  context.strokeStyle = colors.wall;
  context.lineWidth = 2.5;
  context.lineCap = "round";
  for (let k = 0; k < replay.segments.length; k += 4) {
    tracePath(context, view, replay.segments.subarray(k, k + 4));
    context.stroke();
  }
}

function drawFloor(context, view, [left, bottom, right, top], colors) {
  const [x, y] = [view.x(left), view.y(top)];
  context.fillStyle = colors.floor;
  context.fillRect(x, y, view.x(right) - x, view.y(bottom) - y);
  context.strokeStyle = colors.metres;
  context.lineWidth = 1;
  context.beginPath();
  const step = view.scale > 18 ? 1 : view.scale > 4 ? 5 : 25;
  for (let east = Math.ceil(left / step) * step; east <= right; east += step) {
    context.moveTo(view.x(east), y);
    context.lineTo(view.x(east), view.y(bottom));
  }
  for (let north = Math.ceil(bottom / step) * step; north <= top; north += step) {
    context.moveTo(x, view.y(north));
    context.lineTo(view.x(right), view.y(north));
  }
  context.stroke();
}

// Solid cells: one pixel each on a canvas of their own, which is then drawn as large as they are.
function drawGrid(context, view, { shape: [height, width], frame: [east, north, side], cells }, colors) {
  if (!cells.length) return;
  const picture = Object.assign(document.createElement("canvas"), { width, height });
  const pixels = picture.getContext("2d");
  pixels.fillStyle = colors.edge;
  cells.forEach((solid, k) => {
    if (solid) pixels.fillRect(k % width, height - 1 - Math.floor(k / width), 1, 1);
  });
  const scale = view.scale * side;
  context.imageSmoothingEnabled = scale < 1;
  context.drawImage(picture, view.x(east), view.y(north + side * height), scale * width, scale * height);
  context.imageSmoothingEnabled = true;
}

function polygonsOf({ corners, corner_counts: counts }) {
  let at = 0;
  return counts.map((count) => corners.subarray(2 * at, 2 * (at += count)));
}

function tracePath(context, view, points) {
  context.beginPath();
  for (let k = 0; k + 1 < points.length; k += 2) {
    context.lineTo(view.x(points[k]), view.y(points[k + 1]));
  }
}

function disc(context, view, east, north, radius) {
  context.beginPath();
  context.arc(view.x(east), view.y(north), Math.max(radius, 0), 0, TAU);
}
