// Paths on camera images and on the ground seen from above, of the sample that `state` names.
const byId = (id) => document.getElementById(id);
const scene = JSON.parse(byId("scene").textContent);
const samples = scene.samples;
const most = samples[0].best.length;
const state = {sample: 0, count: most, isClose: false, timer: null};
const NEAR_M = 0.5;
const CLOSE_M = [-8, 32];

// Building

function add(parent, tag, attributes = {}) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  parent.append(element);
  return element;
}

function text(parent, tag, content) {
  const element = document.createElement(tag);
  element.textContent = content;
  parent.append(element);
  return element;
}

// Their spaces do not break.
const percent = (p) => (p >= 0.0005 ? `${(100 * p).toFixed(1)}\u00a0%` : "below\u00a00.1\u00a0%");
const line = (points) => `M${points.map((p) => p.join(" ")).join("L")}`;
const dot = ([x, y]) => `M${x} ${y}h0`;
const fromEgo = (path) => [[0, 0], ...path];
const times = (values) => values.map((p) => p / Math.max(values[0], 1e-12));

function colour(strength) {
  return scene.colours[Math.round(strength * (scene.colours.length - 1))];
}

// Paths in metres, best on top: {points, colour, width} of each, from the last to the first.
function planned(sample) {
  const strengths = times(sample.probabilities);
  const shown = sample.best.slice(0, state.count).map((number, rank) => ({
    points: fromEgo(scene.templates[number]),
    colour: colour(strengths[rank]),
    width: 1.4 + 3 * strengths[rank],
  }));
  return shown.reverse();
}

function strokes(parent, path, place) {
  for (const part of place(path.points)) {
    add(parent, "path", {class: "casing", d: line(part), "stroke-width": path.width + 1.4});
    add(parent, "path", {class: "planned-path", d: line(part), stroke: path.colour, "stroke-width": path.width});
  }
  for (const end of place([path.points.at(-1)])) {
    add(parent, "path", {class: "casing", d: dot(end[0]), "stroke-width": path.width + 5});
    add(parent, "path", {class: "planned-end", d: dot(end[0]), stroke: path.colour, "stroke-width": path.width + 3.4});
  }
}

function drivenStrokes(parent, sample, place) {
  const path = fromEgo(sample.driven);
  for (const part of place(path)) {
    add(parent, "path", {class: "driven-casing", d: line(part)});
    add(parent, "path", {class: "driven-path", d: line(part)});
  }
  const step = Math.max(1, Math.round(1 / scene.dt_s));
  for (let k = step; k < path.length; k += step) {
    for (const at of place([path[k]])) {
      add(parent, "path", {class: "casing", d: dot(at[0]), "stroke-width": 7.5});
      add(parent, "path", {class: "second", d: dot(at[0])});
    }
  }
}

// Camera images

// Points at most a quarter of a metre apart, so that a path ends where it leaves the image.
function subdivide(points) {
  const fine = [points[0]];
  for (let k = 1; k < points.length; k++) {
    const [[x, y], [nextX, nextY]] = [points[k - 1], points[k]];
    const num = Math.ceil(Math.hypot(nextX - x, nextY - y) / 0.25);
    for (let j = 1; j <= num; j++) fine.push([x + ((nextX - x) * j) / num, y + ((nextY - y) * j) / num]);
  }
  return fine;
}

// The parts of a path on the ground that a camera sees, in shares of its image.
function seenBy(groundToImage) {
  return (points) => {
    const parts = [[]];
    for (const [x, y] of subdivide(points)) {
      const [u, v, depth] = groundToImage.map((row) => row[0] * x + row[1] * y + row[2]);
      const at = [u / depth, v / depth];
      const isSeen = depth >= NEAR_M && at.every((share) => share > -0.05 && share < 1.05);
      if (isSeen) parts.at(-1).push(at);
      else if (parts.at(-1).length) parts.push([]);
    }
    return parts.filter((part) => part.length > (points.length > 1 ? 1 : 0));
  };
}

const figures = scene.cameras.map((camera) => {
  const figure = document.createElement("figure");
  figure.dataset.name = camera.label;
  figure.style.setProperty("--row", camera.row);
  figure.style.setProperty("--column", camera.column);
  const image = document.createElement("img");
  image.alt = `Image of the camera ${camera.label}`;
  image.decoding = "sync";
  figure.append(image);
  const paths = add(figure, "svg", {viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true"});
  text(figure, "figcaption", camera.label);
  byId("cameras").append(figure);
  return {figure, image, paths};
});

function showCameras(sample) {
  for (const {figure} of figures) figure.classList.add("none");
  for (const seen of sample.images) {
    const {figure, image, paths} = figures[seen.camera];
    figure.classList.remove("none");
    image.src = seen.picture;
    paths.replaceChildren();
    const place = seenBy(seen.image_from_ground);
    for (const path of planned(sample)) strokes(paths, path, place);
    drivenStrokes(paths, sample, place);
  }
}

// From above: x is forward and up, y is left

const [xMin, xMax, yMin, yMax] = scene.grid;
const above = (points) => points.map(([x, y]) => [-y, -x]);
const aspect = (yMax - yMin) / (xMax - xMin);

// Left, top, width and height of what is shown of the ground, in metres.
function view() {
  if (!state.isClose) return [-yMax, -xMax, yMax - yMin, xMax - xMin];
  const height = Math.min(CLOSE_M[1] - CLOSE_M[0], xMax - xMin);
  return [-(height * aspect) / 2, -CLOSE_M[0] - height, height * aspect, height];
}

function placeImage(image, [left, top, width, height]) {
  image.style.left = `${(100 * (-yMax - left)) / width}%`;
  image.style.top = `${(100 * (-xMax - top)) / height}%`;
  image.style.width = `${(100 * (yMax - yMin)) / width}%`;
  image.style.height = `${(100 * (xMax - xMin)) / height}%`;
}

function showAbove(sample) {
  const shown = view();
  const ground = byId("ground");
  ground.setAttribute("viewBox", shown.join(" "));
  for (const [id, picture] of [["cost", sample.cost], ["points", sample.points]]) {
    if (picture) byId(id).src = picture;
    placeImage(byId(id), shown);
  }
  ground.replaceChildren();
  const [originX, originY, yaw] = sample.pose;
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  const toEgo = ([x, y]) => {
    const [dx, dy] = [x - originX, y - originY];
    return [cos * dx + sin * dy, cos * dy - sin * dx];
  };
  for (const edge of scene.road) add(ground, "path", {class: "road", d: line(above(edge.map(toEgo)))});
  for (const box of sample.boxes) add(ground, "path", {class: "box", d: `${line(above(box))}z`});
  add(ground, "path", {class: "ego", d: `${line(above(scene.ego))}z`});
  const place = (points) => [above(points)];
  for (const path of planned(sample)) strokes(ground, path, place);
  drivenStrokes(ground, sample, place);
  const [left, top, width, height] = shown;
  const bar = add(ground, "path", {class: "bar-line", d: `M${left + 0.96 * width} ${top + 0.97 * height}h-10`});
  add(bar, "title").textContent = "10 m";
  ground.setAttribute("aria-label", `From above: ${state.count} planned paths and the driven one. ${words(sample)}`);
}
