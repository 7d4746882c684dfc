// Controls of a page without loading it anew: links and forms that say which parts they change, zoom, readings.
// Everything works without this script; the state is in the address, and the server draws what it says.

const parts = "[data-part]";

function addressWith(values) {
  const url = new URL(window.location.href);
  for (const [name, value] of Object.entries(values)) {
    if (value === null) url.searchParams.delete(name);
    else url.searchParams.set(name, value);
  }
  url.search = url.searchParams.toString().replaceAll("%2C", ",").replaceAll("%3A", ":");
  return url;
}

let asked = 0;

// Take the parts of another address of this page into it.
async function show(url) {
  const turn = ++asked;
  document.body.dataset.busy = "yes";
  const reply = await fetch(url, { headers: { Accept: "text/html" } });
  if (turn !== asked) return;
  if (!reply.ok) { window.location.href = url; return; }
  const other = new DOMParser().parseFromString(await reply.text(), "text/html");
  const focus = document.activeElement?.getAttribute("data-key");
  for (const part of document.querySelectorAll(parts)) {
    const fresh = other.querySelector(`[data-part="${part.dataset.part}"]`);
    if (fresh) part.replaceWith(document.adoptNode(fresh));
  }
  if (focus) document.querySelector(`[data-key="${CSS.escape(focus)}"]`)?.focus();
  window.history.replaceState(null, "", url);
  delete document.body.dataset.busy;
  document.body.dataset.shown = String(turn);
}

document.addEventListener("click", (event) => {
  const link = event.target.closest("a[data-key]");
  if (!link || event.ctrlKey || event.metaKey || event.shiftKey || event.button) return;
  event.preventDefault();
  show(new URL(link.href));
});

document.addEventListener("submit", (event) => {
  const form = event.target.closest("form[data-slider]");
  if (form) event.preventDefault();
});

// An address has no names without a value.
for (const form of document.querySelectorAll("form.filter")) {
  form.addEventListener("formdata", ({ formData }) => {
    for (const [name, value] of [...formData]) if (!value) formData.delete(name);
  });
}

// The slider draws the regions of its channel; the numbers come with them.
const channels = () => (document.getElementById("channels")?.textContent ?? "").split(",").filter(Boolean).map(Number);

function choose(frequency, { later = 60 } = {}) {
  const known = channels();
  if (!known.length) return;
  const apart = known.map((one) => Math.abs(Math.log(one / frequency)));
  const index = apart.indexOf(Math.min(...apart));
  const slider = document.getElementById("frequency");
  slider.value = index;
  document.getElementById("frequency-shown").textContent = `${known[index].toPrecision(3)} MHz`;
  slider.setAttribute("aria-valuetext", `${known[index].toPrecision(3)} MHz`);
  markSpectra(known[index]);
  window.clearTimeout(choose.waiting);
  choose.waiting = window.setTimeout(() => show(addressWith({ frequency: known[index].toPrecision(4) })), later);
}

document.addEventListener("input", (event) => {
  if (event.target.id === "frequency") choose(channels()[Number(event.target.value)], { later: 150 });
});

// Where things are on the figure of the spectra.
function reading(figure, event) {
  const box = figure.getBoundingClientRect();
  const size = figure.viewBox.baseVal;
  const x = (event.clientX - box.left) * (size.width / box.width);
  const y = (event.clientY - box.top) * (size.height / box.height);
  const numbers = (name) => figure.dataset[name].split(",").map(Number);
  const [left, right] = numbers("across");
  const [first, last] = numbers("time");
  const [low, high] = figure.dataset.band ? numbers("band") : [1, 1];
  const height = Number(figure.dataset.height);
  const row = numbers("tops").findIndex((top) => y >= top && y <= top + height);
  if (row < 0 || x < left || x > right) return null;
  const share = (y - numbers("tops")[row]) / height;
  return {
    x, y,
    name: figure.dataset.names.split(",")[row],
    seconds: first + ((x - left) / (right - left)) * (last - first),
    frequency: high * (low / high) ** share,
  };
}

const stamp = (seconds) => new Date(seconds * 1000).toISOString().slice(0, 19);

function markSpectra(frequency) {
  const figure = document.querySelector("svg.spectra[data-band]");
  if (!figure) return;
  const [low, high] = figure.dataset.band.split(",").map(Number);
  const tops = figure.dataset.tops.split(",").map(Number);
  const share = Math.log(high / frequency) / Math.log(high / low);
  figure.querySelectorAll("line.frequency").forEach((line, row) => {
    const y = share >= 0 && share <= 1 ? tops[row] + share * Number(figure.dataset.height) : -9;
    line.setAttribute("y1", y);
    line.setAttribute("y2", y);
  });
}

let pressed = null;
let zoomedAt = 0;

// A part of a day, in whole minutes and at least ten of them.
function zoomDay(...ends) {
  zoomedAt = Date.now();
  const [first, last] = ends.sort((a, b) => a - b).map((one) => Math.round(one / 60));
  const clock = (minutes) => `${String(Math.floor(minutes / 60)).padStart(2, "0")}:${String(minutes % 60).padStart(2, "0")}`;
  const from = Math.min(first, 1430);
  show(addressWith({ t: `${clock(from)},${clock(Math.max(last, from + 10))}` }));
}

// Boxes are links: they are not dragged away, and not followed at the end of a zoom.
document.addEventListener("dragstart", (event) => { if (event.target.closest?.("svg.day")) event.preventDefault(); });
document.addEventListener("click", (event) => {
  if (Date.now() - zoomedAt < 400 && event.target.closest?.("svg.day a")) event.preventDefault();
}, true);

document.addEventListener("pointerdown", (event) => {
  const figure = event.target.closest?.("svg.spectra[data-band], svg.day[data-time]");
  if (!figure || event.button) return;
  const at = reading(figure, event);
  if (!at) return;
  if (figure.dataset.band) event.preventDefault();
  const box = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  box.setAttribute("class", "chosen");
  figure.append(box);
  pressed = { figure, at, box };
});

document.addEventListener("pointermove", (event) => {
  if (pressed) {
    const to = reading(pressed.figure, event);
    if (!to) return;
    const { at, box } = pressed;
    const place = { x: Math.min(at.x, to.x), y: Math.min(at.y, to.y), width: Math.abs(to.x - at.x), height: Math.abs(to.y - at.y) };
    for (const [name, value] of Object.entries(place)) box.setAttribute(name, value);
    pressed.to = to;
    return;
  }
  const figure = event.target.closest?.("svg.spectra[data-band]");
  const said = document.getElementById("reading");
  if (!figure || !said) return;
  const at = reading(figure, event);
  said.textContent = at ? `${at.name}: ${stamp(at.seconds).slice(11)} UTC, ${at.frequency.toPrecision(3)} MHz` : "";
});

document.addEventListener("pointercancel", () => {
  pressed?.box.remove();
  pressed = null;
});

document.addEventListener("pointerup", () => {
  if (!pressed) return;
  const { figure, at, to, box } = pressed;
  box.remove();
  pressed = null;
  if (!figure.dataset.band) {
    if (to && Math.abs(to.x - at.x) >= 12) zoomDay(at.seconds, to.seconds);
    return;
  }
  if (!to || Math.abs(to.x - at.x) < 12 || to.name !== at.name) {
    choose(at.frequency, { later: 0 });
    return;
  }
  const times = [at.seconds, to.seconds].sort((a, b) => a - b).map(stamp);
  const band = [at.frequency, to.frequency].sort((a, b) => a - b).map((one) => +one.toPrecision(4));
  const isWide = band[1] / band[0] > 1.05;
  if (times[0] !== times[1]) show(addressWith({ t: times.join(","), ...(isWide ? { f: band.join(",") } : {}) }));
});

document.addEventListener("click", (event) => {
  const dot = event.target.closest?.("circle[data-mhz]");
  if (dot) choose(Number(dot.dataset.mhz), { later: 0 });
});

document.getElementById("copy-link")?.addEventListener("click", async (event) => {
  if (event.ctrlKey || event.metaKey || event.shiftKey) return;
  event.preventDefault();
  const note = document.getElementById("copied");
  const kept = new URL(event.target.href);
  for (const [name, value] of new URL(window.location.href).searchParams) kept.searchParams.set(name, value);
  const text = kept.href.replaceAll("%2C", ",").replaceAll("%3A", ":");
  try {
    await navigator.clipboard.writeText(text);
    note.textContent = "copied";
  } catch {
    note.textContent = text;
  }
});

// The source moves out as it did, each channel when it was emitted: the burst in four seconds.
document.addEventListener("click", (event) => {
  const button = event.target.closest("#play");
  if (!button) return;
  const dots = [...document.querySelectorAll("svg.constellation .dots circle")].reverse();
  const clock = document.getElementById("emitted");
  let latest = -Infinity;
  const times = dots.map((dot, index) => (latest = Math.max(latest, dot.dataset.utc ? Date.parse(`${dot.dataset.utc}Z`) : index)));
  const share = (index) => (times[index] - times[0]) / Math.max(1, latest - times[0]);
  let shown = 0;
  for (const dot of dots) dot.setAttribute("visibility", "hidden");
  window.clearInterval(window.playing);
  const begin = performance.now();
  window.playing = window.setInterval(() => {
    const elapsed = (performance.now() - begin) / 4000;
    for (; shown < dots.length && share(shown) <= elapsed; shown += 1) {
      const { mhz, utc } = dots[shown].dataset;
      dots[shown].removeAttribute("visibility");
      markSpectra(Number(mhz));
      clock.textContent = `${Number(mhz).toPrecision(3)} MHz${utc ? ` emitted at ${utc.slice(11)} UTC` : ""}`;
    }
    if (elapsed > 1.2) {
      window.clearInterval(window.playing);
      markSpectra(-1);
    }
  }, 25);
});
