// The burst page: two figures, one frequency, and which tracks are shown.

import { draw, failed, fetched, tracesWith } from "./plot.js";
import { read, write } from "./state.js";

const frame = document.getElementById("figures");
const constellation = document.getElementById("constellation");
const spectra = document.getElementById("spectra");
const slider = document.getElementById("frequency");
const shown = document.getElementById("frequency-shown");
const rows = document.getElementById("selected-rows");
const channels = slider.dataset.channels.split(",").filter(Boolean).map(Number);
const hidden = new Set((read("hidden") ?? "").split(",").filter(Boolean));
const drawn = [];

let asked = 0;

function address(url, extra = {}) {
  const query = new URLSearchParams(frame.dataset.series);
  for (const [name, value] of Object.entries(extra)) query.set(name, value);
  return query.size ? `${url}?${query}` : url;
}

function nearest(frequency) {
  const apart = channels.map((channel) => Math.abs(Math.log(channel / frequency)));
  return apart.indexOf(Math.min(...apart));
}

function show(frequency) {
  shown.textContent = `${frequency.toPrecision(3)} MHz`;
  slider.setAttribute("aria-valuetext", shown.textContent);
  markFrequency(frequency);
}

function markFrequency(frequency) {
  if (!drawn.includes(spectra)) return;
  const axes = [...new Set(spectra.data.map((trace) => trace.yaxis ?? "y"))];
  const shapes = axes.map((yref) => ({
    type: "line", xref: "paper", x0: 0, x1: 1, yref, y0: frequency, y1: frequency,
    line: { color: "#ffffff", width: 1.2, dash: "dot" },
  }));
  window.Plotly.relayout(spectra, { shapes });
}

async function highlight(frequency) {
  const turn = ++asked;
  const reply = await fetched(address(frame.dataset.regions, { frequency_mhz: frequency }));
  if (turn !== asked) return;
  rows.replaceChildren(...reply.regions.map(row));
  if (!drawn.includes(constellation)) return;
  const traces = tracesWith(constellation, "selected");
  const outline = ([trace]) => reply.regions.find((region) => region.edge === trace.meta.edge)?.[`region${trace.meta.percent}`];
  const known = traces.filter((one) => outline(one));
  const update = { x: known.map((one) => outline(one).x), y: known.map((one) => outline(one).y) };
  window.Plotly.restyle(constellation, update, known.map(([, index]) => index));
}

function interval(middle, sd) {
  const [shown, low, high] = [middle, middle - sd, middle + sd].map((value) => value.toFixed(1).replace("-", "−"));
  return `${shown} (${low} to ${high})`;
}

function row(region) {
  const line = document.createElement("tr");
  const name = document.createElement("th");
  name.scope = "row";
  const key = document.createElement("span");
  key.className = `key ${region.edge}`;
  key.setAttribute("aria-hidden", "true");
  name.append(key, region.label);
  const cells = [
    interval(region.range_rsun, region.range_sd_rsun),
    interval(region.longitude_deg, region.longitude_sd_deg),
    region.area68_rsun2.toFixed(0),
  ].map((text) => Object.assign(document.createElement("td"), { className: "number", textContent: text }));
  line.append(name, ...cells);
  line.title = region.speed;
  return line;
}

function choose(index, { remember = true } = {}) {
  slider.value = index;
  const frequency = channels[index];
  show(frequency);
  if (remember) write({ frequency: frequency.toPrecision(4) });
  window.clearTimeout(choose.waiting);
  choose.waiting = window.setTimeout(() => highlight(frequency).catch((error) => { shown.textContent = error.message; }), 60);
}

function applyHidden() {
  for (const element of drawn) {
    const indices = element.data.map((trace, index) => index).filter((index) => element.data[index].legendgroup);
    const visible = indices.map((index) => (hidden.has(element.data[index].legendgroup) ? "legendonly" : true));
    if (indices.length) window.Plotly.restyle(element, { visible }, indices);
  }
  write({ hidden: hidden.size ? [...hidden].sort().join(",") : null });
}

function onLegend(event) {
  const group = event.data[event.curveNumber].legendgroup;
  if (hidden.has(group)) hidden.delete(group);
  else hidden.add(group);
  applyHidden();
  return false;
}

async function figure(element, url, axes) {
  try {
    await draw(element, await fetched(address(url)), axes);
    drawn.push(element);
    element.on("plotly_legendclick", onLegend);
    element.on("plotly_legenddoubleclick", () => false);
  } catch (error) {
    failed(element, error);
  }
}

// Square window around all that is drawn of the shown tracks, the Sun included.
function trackWindow() {
  const around = [[0], [0]];
  for (const trace of constellation.data) {
    if (trace.meta?.role !== "region" || trace.visible === "legendonly") continue;
    around[0].push(...trace.x.filter(Number.isFinite));
    around[1].push(...trace.y.filter(Number.isFinite));
  }
  const [[west, east], [south, north]] = around.map((values) => [Math.min(...values), Math.max(...values)]);
  const half = 0.54 * Math.max(east - west, north - south);
  const centre = [(west + east) / 2, (south + north) / 2];
  return centre.map((middle) => [middle - half, middle + half]);
}

function zoomTo([x, y]) {
  window.Plotly.relayout(constellation, { "xaxis.range": x, "yaxis.range": y });
}

function frequencyAt(point) {
  return typeof point.y === "number" && point.y > 0 ? point.y : null;
}

async function start() {
  await Promise.all([
    figure(constellation, frame.dataset.constellation, { x: "xaxis", y: "yaxis" }),
    figure(spectra, frame.dataset.spectra, { t: "xaxis", f: "yaxis" }),
  ]);
  if (hidden.size) applyHidden();
  if (drawn.includes(constellation)) {
    document.getElementById("zoom-track").addEventListener("click", () => zoomTo(trackWindow()));
    document.getElementById("zoom-out").addEventListener("click", () => zoomTo(constellation.whole));
  }
  if (channels.length === 0) return;
  slider.addEventListener("input", () => choose(Number(slider.value)));
  if (drawn.includes(spectra)) spectra.on("plotly_click", (event) => {
    const frequency = frequencyAt(event.points[0]);
    if (frequency) choose(nearest(frequency));
  });
  if (drawn.includes(constellation)) constellation.on("plotly_click", (event) => {
    const log = event.points[0].data.marker?.color?.[event.points[0].pointNumber];
    if (typeof log === "number") choose(nearest(10 ** log));
  });
  const wanted = Number(read("frequency"));
  choose(wanted > 0 ? nearest(wanted) : Number(slider.value), { remember: wanted > 0 });
  document.body.dataset.drawn = drawn.length;
}

document.getElementById("copy-link").addEventListener("click", async () => {
  const note = document.getElementById("copied");
  try {
    await navigator.clipboard.writeText(window.location.href);
    note.textContent = "copied";
  } catch {
    note.textContent = "copy it from the address bar";
  }
  window.setTimeout(() => { note.textContent = ""; }, 4000);
});

start();
