// Fetching a figure, drawing it in the colours of the page, and keeping its zoom in the address.

import { readRange, write, writtenRange } from "./state.js";

const CONFIG = {
  responsive: true,
  displaylogo: false,
  displayModeBar: "hover",
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
  plotlyServerURL: "",
  showTips: false,
};

export const dark = window.matchMedia("(prefers-color-scheme: dark)");

export async function fetched(url) {
  const reply = await fetch(url, { headers: { Accept: "application/json" } });
  const body = await reply.json();
  if (!reply.ok) throw new Error(body.detail ?? reply.statusText);
  return body;
}

export function failed(element, error) {
  const note = document.createElement("p");
  note.className = "failed";
  note.textContent = error.message;
  element.replaceChildren(note);
}

function colours() {
  const style = getComputedStyle(document.documentElement);
  const named = (name) => style.getPropertyValue(name).trim();
  return { ink: named("--ink"), soft: named("--soft"), grid: named("--grid"), card: named("--card"), line: named("--line") };
}

function themed(layout) {
  const { ink, soft, grid, card, line } = colours();
  const look = { "font.color": ink, "hoverlabel.bgcolor": card, "hoverlabel.bordercolor": line, "hoverlabel.font.color": ink, "modebar.bgcolor": "rgba(0,0,0,0)", "modebar.color": soft, "modebar.activecolor": ink };
  for (const axis of Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key))) {
    Object.assign(look, { [`${axis}.linecolor`]: grid, [`${axis}.tickcolor`]: grid, [`${axis}.tickfont.color`]: soft, [`${axis}.title.font.color`]: soft });
  }
  return look;
}

// The ends of a logarithmic axis are logarithms; the address has the values themselves.
function onAxis(range, axis, convert) {
  if (!range || axis.type !== "log") return range;
  const ends = range.map((end) => convert(Number(end)));
  return ends.every(Number.isFinite) ? ends : null;
}

// `axes` names the query parameter of each axis: {x: "xaxis", ...}
export async function draw(element, figure, axes) {
  const full = Object.fromEntries(Object.values(axes).map((axis) => [axis, figure.layout[axis].range?.slice() ?? null]));
  element.whole = Object.values(full);
  for (const [name, axis] of Object.entries(axes)) {
    const range = onAxis(readRange(name), figure.layout[axis], Math.log10);
    if (range) Object.assign(figure.layout[axis], { range, autorange: false });
  }
  await window.Plotly.newPlot(element, figure.data, figure.layout, CONFIG);
  await window.Plotly.relayout(element, themed(figure.layout));
  dark.addEventListener("change", () => window.Plotly.relayout(element, themed(figure.layout)));
  element.on("plotly_relayout", (change) => remember(element, axes, full, change));
  return element;
}

function remember(element, axes, full, change) {
  const touched = Object.keys(change).filter((key) => /^[xy]axis\d*\.(range|autorange)/.test(key));
  if (touched.length === 0) return;
  const reset = touched.some((key) => key.endsWith("autorange"));
  const shown = Object.entries(axes).map(([name, axis]) => {
    const range = element.layout[axis].range;
    return [name, reset || String(range) === String(full[axis]) ? null : writtenRange(onAxis(range, element.layout[axis], (log) => 10 ** log))];
  });
  write(Object.fromEntries(shown));
}

export function tracesWith(element, role) {
  return element.data.map((trace, index) => [trace, index]).filter(([trace]) => trace.meta?.role === role);
}
