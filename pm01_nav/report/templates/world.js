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

// Solid cells, neighbours of a row in one piece.
function drawGrid(context, view, { shape: [height, width], frame: [east, north, side], cells }, colors) {
  context.fillStyle = colors.edge;
  const tall = view.scale * side + 0.5;
  for (let row = 0; row < height; row++) {
    for (let begin = 0; begin < width; begin++) {
      if (!cells[row * width + begin]) continue;
      let end = begin;
      while (end < width && cells[row * width + end]) end++;
      const [x, y] = [view.x(east + side * begin), view.y(north + side * (row + 1))];
      context.fillRect(x, y, view.scale * side * (end - begin) + 0.5, tall);
      begin = end;
    }
  }
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
