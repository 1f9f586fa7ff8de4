// What `widget.js`, which the first argument names, says to Python when hands do something, as lines of JSON: in Node, with as much of a
// page as it asks for.

import { pathToFileURL } from "node:url";

class Element {
  constructor(name) {
    Object.assign(this, { name, children: [] });
  }
  append(...children) {
    this.children.push(...children);
  }
  addEventListener(kind, does) {
    this[`on${kind}`] = does;
  }
  getBoundingClientRect() {
    return { left: 10, top: 20, width: 192, height: 128 };
  }
  getContext() {
    return {};
  }
  setAttribute() {}
  setPointerCapture() {}
}

let frames = [];
globalThis.document = { createElement: (name) => new Element(name) };
globalThis.requestAnimationFrame = (draw) => frames.push(draw);
globalThis.WheelEvent = { DOM_DELTA_LINE: 1 };
const drawn = () => frames.splice(0).forEach((draw) => draw());
const event = (said) => ({ preventDefault() {}, stopPropagation() {}, ...said });

const about = { size: [96, 64], modes: ["points"], attributes: ["temperature"], color_maps: ["viridis"], times: [] };
const model = { get: () => about, send: (message) => console.log(JSON.stringify(message)), on() {}, off() {} };
const page = new Element("div");
const { default: widget } = await import(pathToFileURL(process.argv[2]));
widget.render({ model, el: page });

const all = (element) => [element, ...(element.children ?? []).flatMap(all)];
const named = (name) => all(page).filter((element) => element.name === name);
const [canvas] = named("canvas");
// What is done between two frames of the browser is one message, of each kind.
for (const shiftKey of [false, false, true]) canvas.onkeydown(event({ key: "ArrowLeft", shiftKey }));
drawn();
const finger = { pointerId: 1, button: 0, buttons: 1 };
canvas.onpointerdown(event({ ...finger, clientX: 50, clientY: 60 }));
canvas.onpointermove(event({ ...finger, clientX: 70, clientY: 60 }));
canvas.onpointerup(event({ ...finger, clientX: 70, clientY: 60 }));
drawn();
canvas.onwheel(event({ deltaMode: 0, deltaY: 500, clientX: 106, clientY: 84 }));
drawn();
canvas.onpointerdown(event({ ...finger, clientX: 106, clientY: 84 }));
canvas.onpointerup(event({ ...finger, clientX: 106, clientY: 84 }));
const [mode, , map, scale] = named("select");
for (const [select, value] of [[mode, "points"], [map, "viridis"], [scale, "linear"], [map, ""]]) {
  select.value = value;
  select.onchange();
}
named("button")[0].onclick();
