// What is looked at stands in the query of the address, so that a copied link shows the same view.

const NUMBER = /^-?\d+(\.\d+)?(e-?\d+)?$/;

export function read(name) {
  return new URLSearchParams(window.location.search).get(name);
}

export function write(values) {
  const query = new URLSearchParams(window.location.search);
  for (const [name, value] of Object.entries(values)) {
    if (value === null) query.delete(name);
    else query.set(name, value);
  }
  const text = query.toString().replaceAll("%2C", ",").replaceAll("%3A", ":");
  window.history.replaceState(null, "", text ? `?${text}` : window.location.pathname);
}

// A range is two numbers, or two UTC times, with a comma between them; anything else counts as absent.
export function readRange(name) {
  const ends = (read(name) ?? "").split(",");
  if (ends.length !== 2) return null;
  if (ends.every((end) => NUMBER.test(end))) return ends.map(Number);
  return ends.every((end) => !Number.isNaN(Date.parse(`${end}Z`))) ? ends : null;
}

export function writtenRange(range) {
  if (!range) return null;
  return range.map((end) => (typeof end === "number" ? +end.toPrecision(5) : end.replace(" ", "T").slice(0, 19))).join(",");
}
