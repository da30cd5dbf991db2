// Runs robot_viewer.js on a page that only remembers what is drawn, and prints that as JSON.
import { readFileSync } from "node:fs";
const [viewer, figure] = process.argv.slice(2).map((path) => readFileSync(path, "utf8"));
const drawn = { faces: [], labels: [] };
let path = [];
const pen = {
  scale() {}, closePath() {}, beginPath() { path = []; }, moveTo() {}, lineTo(x, y) { path.push([x, y]); },
  fill() { drawn.faces.push({ corners: path, colour: this.fillStyle }); }, stroke() {},
  measureText: (text) => ({ width: 6 * text.length }),
  fillText(text, x, y) { drawn.labels.push({ text, x, y }); },
};
const heard = {};
const element = () => ({
  style: {}, append() {}, after() {}, addEventListener(name, act) { heard[name] = act; }, getContext: () => pen, setPointerCapture() {},
});
const elements = { "robot-scene": { ...element(), clientWidth: 400, clientHeight: 300 }, "robot-figure": { textContent: figure } };
const made = [];
globalThis.document = {
  getElementById: (id) => elements[id], body: {}, activeElement: null,
  createElement: () => { made.push(element()); return made.at(-1); },
};
globalThis.window = { matchMedia: () => ({ addEventListener() {} }) };
globalThis.ResizeObserver = class { observe() {} };
globalThis.getComputedStyle = () => ({ color: "black" });
new Function(viewer)();
const first = { faces: drawn.faces, labels: [...drawn.labels] };
heard.pointermove({ offsetX: 200, offsetY: 150 });
const tip = made[1].textContent;
drawn.faces = [];
heard.keydown({ key: "ArrowLeft", preventDefault() {} });
const turned = drawn.faces;
heard.keydown({ key: "ArrowRight", preventDefault() {} });
drawn.faces = [];
const slider = made.find((one) => one.type === "range");
if (slider) {
  slider.value = "1";
  heard.input();
}
const time = made.at(-1).textContent;
console.log(JSON.stringify({ ...first, tip, turned, slid: drawn.faces, time }));
