// What is shown of a scene, and what keys and mouse do. All follows from `state`, see drawing.js.

// Ranked templates

function aside(y) {
  const distance = Math.abs(y).toFixed(1);
  return distance === "0.0" ? "" : `${distance} m ${y > 0 ? "left" : "right"}`;
}

function showRanked(sample) {
  byId("rows").replaceChildren();
  const strengths = times(sample.probabilities);
  for (let rank = 0; rank < state.count; rank++) {
    const number = sample.best[rank];
    const row = document.createElement("tr");
    if (number === sample.label) row.className = "nearest";
    text(row, "td", rank + 1);
    const cell = text(row, "td", "");
    cell.className = "probability";
    const bar = text(cell, "span", "");
    bar.className = "bar";
    bar.style.setProperty("--strength", strengths[rank]);
    bar.style.background = colour(strengths[rank]);
    cell.append(percent(sample.probabilities[rank]), number === sample.label ? " as driven" : "");
    const [x, y] = scene.templates[number].at(-1);
    text(row, "td", `${x.toFixed(1)} m`);
    text(row, "td", aside(y));
    byId("rows").append(row);
  }
  byId("count").textContent = state.count;
  byId("fewer").disabled = state.count === 1;
  byId("more").disabled = state.count === most;
}

// Probability over time, on a logarithmic scale

const lowest = Math.floor(Math.log10(0.2 / scene.num_templates));
const across = (k) => (k + 0.5) / samples.length;
const down = (p) => 0.92 * Math.min(1, Math.log10(Math.max(p, 1e-30)) / lowest);
const chart = byId("chart");

function drawChart() {
  for (let power = 0; power >= lowest; power--) {
    add(chart, "path", {class: "grid", d: `M0 ${down(10 ** power)}H1`});
    const label = text(byId("scale"), "span", `${Number((100 * 10 ** power).toPrecision(1))} %`);
    label.style.top = `${100 * down(10 ** power)}%`;
  }
  add(chart, "path", {class: "chance", d: `M0 ${down(1 / scene.num_templates)}H1`});
  // The end of no length is what is seen of a single sample.
  const curve = (value) => `${line(samples.map((sample, k) => [across(k), down(value(sample))]))}h0`;
  add(chart, "path", {class: "best", d: curve((sample) => sample.probabilities[0])});
  add(chart, "path", {class: "label", d: curve((sample) => sample.label_probability)});
  samples.forEach((sample, k) => {
    add(chart, "path", {class: "sample", d: dot([across(k), 0.975])});
    if (sample.hit < 0.5) add(chart, "path", {class: "missed", d: dot([across(k), 0.975])});
  });
  const hits = samples.reduce((sum, sample) => sum + sample.hit, 0);
  chart.setAttribute(
    "aria-label",
    `Probability over ${samples.length} samples of the most probable template and of the one nearest to the ` +
      `driven path; in ${Number(hits.toFixed(1))} of them that one is among the ten best.`,
  );
  return add(chart, "path", {class: "now"});
}

const now = drawChart();

function chartSample(event) {
  const box = chart.getBoundingClientRect();
  return Math.floor(((event.clientX - box.left) / box.width) * samples.length);
}

// All together

function verdict(sample) {
  if (sample.hit >= 1) return "Top-10 hit";
  return sample.hit > 0 ? "Top-10 open, as equally probable templates are parted" : "Top-10 missed";
}

function when(sample) {
  return `Sample ${state.sample + 1} of ${samples.length}, ${sample.time_s.toFixed(1)} s. `;
}

function standing(sample) {
  const share = percent(sample.label_probability);
  return `: what was driven ranks ${sample.rank} of ${scene.num_templates}, probability ${share}.`;
}

const words = (sample) => when(sample) + verdict(sample) + standing(sample);

function draw() {
  const sample = samples[state.sample];
  showCameras(sample);
  showAbove(sample);
  showRanked(sample);
  now.setAttribute("d", `M${across(state.sample)} 0V1`);
  byId("status").textContent = when(sample);
  text(byId("status"), "strong", verdict(sample));
  byId("status").append(standing(sample));
  byId("slider").value = state.sample;
  byId("slider").setAttribute("aria-valuetext", words(sample));
  byId("token").textContent = sample.token;
}

const clamp = (value, low, high) => Math.max(low, Math.min(high, value));

function show(number) {
  state.sample = clamp(number, 0, samples.length - 1);
  draw();
}

function showCount(count) {
  state.count = clamp(count, 1, most);
  draw();
}

function toggleClose() {
  state.isClose = !state.isClose;
  byId("close-up").setAttribute("aria-pressed", state.isClose);
  draw();
}

function stop() {
  clearTimeout(state.timer);
  state.timer = null;
  byId("play").textContent = "Play";
  byId("play").setAttribute("aria-pressed", false);
  byId("status").setAttribute("aria-live", "polite");
}

// At the speed it was driven.
function advance() {
  const next = state.sample + 1;
  if (next >= samples.length) return stop();
  const wait_s = samples[next].time_s - samples[state.sample].time_s;
  state.timer = setTimeout(() => {
    show(next);
    advance();
  }, 1000 * wait_s);
}

function play() {
  if (state.timer !== null) return stop();
  if (state.sample === samples.length - 1) show(0);
  byId("play").textContent = "Pause";
  byId("play").setAttribute("aria-pressed", true);
  byId("status").setAttribute("aria-live", "off");
  advance();
}

function seek(number) {
  stop();
  show(number);
}

const keys = {
  ArrowLeft: () => seek(state.sample - 1),
  ArrowRight: () => seek(state.sample + 1),
  Home: () => seek(0),
  End: () => seek(samples.length - 1),
  " ": play,
  "+": () => showCount(state.count + 1),
  "-": () => showCount(state.count - 1),
  c: toggleClose,
};

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key === " " && event.target.closest("button")) return;
  const isDigit = /^[0-9]$/.test(event.key);
  const act = isDigit ? () => showCount(Number(event.key) || 10) : keys[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});

byId("previous").addEventListener("click", keys.ArrowLeft);
byId("next").addEventListener("click", keys.ArrowRight);
byId("play").addEventListener("click", play);
byId("fewer").addEventListener("click", keys["-"]);
byId("more").addEventListener("click", keys["+"]);
byId("close-up").addEventListener("click", toggleClose);
byId("slider").addEventListener("input", (event) => seek(Number(event.target.value)));
chart.addEventListener("pointerdown", (event) => {
  if (event.button === 0) seek(chartSample(event));
});
chart.addEventListener("pointermove", (event) => {
  if (event.buttons === 1) seek(chartSample(event));
});

byId("name").textContent = scene.name;
byId("description").textContent = scene.description;
byId("about").textContent = scene.about.join(" ");
byId("cost-range").textContent = `cost ${scene.cost_range.join(" to ")}, dark is dear`;
byId("slider").max = samples.length - 1;
byId("map").style.setProperty("--aspect", aspect);
byId("key-road").hidden = !scene.road.length;
byId("key-boxes").hidden = !samples.some((sample) => sample.boxes.length);
document.querySelector("main").classList.toggle("blind", !scene.cameras.length);
draw();
