// The browser's part of the widget, in notebooks and in the page of `deepfield serve --view`: shows the frames that it gets, and tells what
// the mouse and the keys do.

const STYLE = `
.deepfield { display: inline-block; font: 12px system-ui, sans-serif; }
.deepfield canvas { display: block; background: #000; cursor: grab; touch-action: none; outline-offset: 2px; }
.deepfield .row { display: flex; flex-wrap: wrap; gap: 8px; align-items: center; padding: 4px 0; }
.deepfield .row input[type=range] { flex: 1; min-width: 120px; }
.deepfield .told { min-height: 1.3em; white-space: pre-wrap; opacity: 0.8; }
`;

const made = (name, attributes = {}, ...children) => {
  const element = Object.assign(document.createElement(name), attributes);
  element.append(...children);
  return element;
};

const number = (value) => (value == null ? "none" : Number(value.toPrecision(4)).toString());

const withUnit = (value, unit) => `${number(value)}${unit ? " " + unit : ""}`;

// What was found at a pixel, in words.
function pickedText({ place, unit, values, units, radius, probe }) {
  const parts = Object.entries(values).map(([name, value]) => `${name} ${withUnit(value, units[name])}`);
  const lines = [`(${place.map(number).join(", ")})${unit ? " " + unit : ""}: ${parts.join(", ")}`];
  if (probe) {
    lines.push(`within ${withUnit(radius, unit)}: ${probe.count} particles, mass ${number(probe.mass)}`);
  }
  return lines.join("\n");
}

function render({ model, el }) {
  const about = model.get("about");
  const [width, height] = about.size;
  const canvas = made("canvas", { width, height, tabIndex: 0, role: "application" });
  const keysTold = "arrows turn it, with Shift they move it, plus and minus zoom, Enter asks what is in the middle, Home goes back";
  canvas.setAttribute("aria-label", `a picture: ${keysTold}`);
  const context = canvas.getContext("2d");
  const told = made("div", { className: "told", role: "status", textContent: "drawing ..." });
  // What was told of a pixel stays until the view changes.
  let answer = "";
  const send = (message) => {
    if (message.do !== "pick") answer = "";
    model.send(message);
  };

  const choice = (label, name, options) => {
    const select = made("select", {}, made("option", { value: "", textContent: "usual" }));
    for (const option of options) select.append(made("option", { value: option, textContent: option }));
    select.value = about[name] ?? "";
    select.onchange = () => send({ do: "choose", [name]: select.value || null });
    return made("label", {}, `${label} `, select);
  };
  const row = made("div", { className: "row" });
  if (about.modes.length) row.append(choice("mode", "mode", about.modes));
  if (about.attributes.length) row.append(choice("colour", "attribute", about.attributes));
  row.append(choice("colour map", "color_map", about.color_maps), choice("scale", "color_scale", ["log", "linear"]));
  row.append(made("button", { textContent: "home", onclick: () => send({ do: "home" }) }));
  if (about.times.length > 1) {
    const [first, last] = [about.times[0], about.times[about.times.length - 1]];
    const shown = made("span", { textContent: number(about.time ?? first) });
    const slider = made("input", { type: "range", min: first, max: last, step: (last - first) / 1000 });
    slider.value = about.time ?? first;
    slider.oninput = () => {
      shown.textContent = number(slider.valueAsNumber);
      send({ do: "choose", time: slider.valueAsNumber });
    };
    row.append(made("label", {}, "time ", slider, " ", shown));
  }
  el.append(made("div", { className: "deepfield" }, made("style", { textContent: STYLE }), canvas, row, told));

  // What was moved since the last frame of the browser is one message.
  let waiting = null;
  const move = (what, change) => {
    if (waiting && waiting.do !== what) flush();
    if (!waiting) {
      waiting = { do: what };
      requestAnimationFrame(flush);
    }
    change(waiting);
  };
  function flush() {
    if (waiting) send(waiting);
    waiting = null;
  }
  const drag = (what, x, y) =>
    move(what, (message) => {
      message.x = (message.x ?? 0) + x;
      message.y = (message.y ?? 0) + y;
    });
  const zoom = (factor, x, y) =>
    move("zoom", (message) => {
      message.factor = (message.factor ?? 1) * factor;
      Object.assign(message, { x, y });
    });
  // The page may show the canvas larger or smaller than it is.
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  };

  // Where the mouse or the fingers are that hold the picture.
  const held = new Map();
  let way = 0;
  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    // Two fingers are no click.
    way = held.size ? Infinity : 0;
    held.set(event.pointerId, at(event));
  };
  canvas.onpointermove = (event) => {
    const last = held.get(event.pointerId);
    if (!last || !event.buttons) return;
    const now = at(event);
    const [x, y] = [now[0] - last[0], now[1] - last[1]];
    way += Math.hypot(x, y);
    // A click is no drag, though the hand trembles.
    if (way < 3) return;
    held.set(event.pointerId, now);
    if (held.size === 1) return drag(about.flat || event.shiftKey || event.buttons !== 1 ? "pan" : "turn", x, y);
    // Two fingers move the picture with their middle, and zoom about it.
    const [, other] = [...held].find(([id]) => id !== event.pointerId);
    const [before, after] = [last, now].map((place) => Math.max(Math.hypot(place[0] - other[0], place[1] - other[1]), 1));
    drag("pan", x / 2, y / 2);
    zoom(before / after, (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
  };
  canvas.onpointerup = (event) => {
    const last = held.get(event.pointerId);
    if (last && way < 3 && event.button === 0) send({ do: "pick", x: last[0], y: last[1] });
    held.delete(event.pointerId);
  };
  canvas.onpointercancel = (event) => held.delete(event.pointerId);
  canvas.oncontextmenu = (event) => event.preventDefault();
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
      zoom(Math.exp(0.002 * lines * event.deltaY), ...at(event));
    },
    { passive: false },
  );
  const keys = {
    ArrowLeft: [-20, 0],
    ArrowRight: [20, 0],
    ArrowUp: [0, -20],
    ArrowDown: [0, 20],
  };
  canvas.onkeydown = (event) => {
    if (keys[event.key]) drag(about.flat || event.shiftKey ? "pan" : "turn", ...keys[event.key]);
    else if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 0.8 : 1.25, width / 2, height / 2);
    else if (event.key === "Home") send({ do: "home" });
    else if (event.key === "Enter") send({ do: "pick", x: width / 2, y: height / 2 });
    else return;
    event.preventDefault();
    event.stopPropagation();
  };

  // Pictures are decoded beside each other; one that is late is not shown over a newer one.
  let [arrived, shown] = [0, 0];
  const show = async (message, [buffer]) => {
    const mine = ++arrived;
    const picture = await createImageBitmap(new Blob([buffer], { type: message.type ?? "image/png" }));
    if (mine > shown) {
      shown = mine;
      context.clearRect(0, 0, width, height);
      context.drawImage(picture, 0, 0, width, height);
      const hue = message.attribute ? ` of ${message.attribute}` : "";
      const tall = message.span == null ? "" : `, ${withUnit(message.span, message.unit)} tall`;
      const state = message.finished ? "" : ` (${message.size.join(" x ")} while it moves)`;
      told.textContent = answer || `${message.mode}${hue}${tall}, ${Math.round(message.milliseconds)} ms${state}`;
    }
    picture.close();
  };
  const receive = (message, buffers) => {
    if (message.kind === "frame") show(message, buffers);
    else if (message.kind === "picked") told.textContent = answer = pickedText(message);
    else if (message.kind === "moved") answer = "";
    else if (message.kind === "error") told.textContent = message.text;
  };
  model.on("msg:custom", receive);
  send({ do: "begin" });
  return () => model.off("msg:custom", receive);
}

export default { render };
