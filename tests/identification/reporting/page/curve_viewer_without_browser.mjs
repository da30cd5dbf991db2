// Runs curve_viewer.js on a page that only remembers what is drawn, and prints that as JSON: at first, after each key.
import { readFileSync } from "node:fs";
const [viewer, curves] = process.argv.slice(2, 4).map((path) => readFileSync(path, "utf8"));
const heard = {};
const element = () => ({
  innerHTML: "", textContent: "", clientWidth: 674, addEventListener(name, act) { heard[name] = act; }, setPointerCapture() {},
  getBoundingClientRect: () => ({ left: 0 }),
});
const parts = { ".drawing": element(), ".reading": element() };
const place = { ...element(), id: "curves-0", querySelector: (name) => parts[name], querySelectorAll: () => [] };
globalThis.document = {
  getElementById: (id) => (id === "time-curves" ? { textContent: curves } : place), activeElement: null,
};
globalThis.ResizeObserver = class { observe() {} };
new Function(viewer)();
const drawn = [parts[".drawing"].innerHTML];
for (const key of process.argv.slice(4)) {
  heard.keydown({ key, preventDefault() {} });
  drawn.push(parts[".drawing"].innerHTML);
}
heard.pointermove({ pointerId: 1, clientX: 64 });
console.log(JSON.stringify({ drawn, reading: parts[".reading"].textContent }));
