// Data in a browser: the notebook's widget, with a model that asks the server for pictures in place of a notebook's kernel.

import widget from "./widget.js";

// As deepfield/orbit.py: how far the line of sight stays from the axis that it turns about, and the smallest and the largest height of the
// picture, in the first one's.
const POLE = Math.PI / 180;
const SPAN = [1e-7, 1e4];
// As Pace of deepfield/widget.py: seconds of a picture that moves, the smallest share of its sides, and the largest of its error.
const BUDGET = 0.15;
const SMALLEST = 1 / 6;
const COARSEST = 8;
const ERROR_PX = 0.8;
// Milliseconds after which a picture is finished, between signs that somebody looks, and until what got no answer is asked again: the first
// time, and at most.
const REST = 250;
const SIGN = 45000;
const AGAIN = [500, 16000];
// The radius of what is asked about at the cursor, pixels.
const PICKED = 6;

const add = (a, b, factor = 1) => a.map((value, axis) => value + factor * b[axis]);
const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
const scaled = (a, factor) => a.map((value) => value * factor);
const unit = (a) => scaled(a, 1 / Math.hypot(...a));
const cross = (a, b) => [0, 1, 2].map((i) => a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
const clamp = (value, least, most) => Math.min(Math.max(value, least), most);

// Rodrigues' rotation about a unit vector.
const turned = (vector, axis, angle) => {
  const along = scaled(axis, dot(axis, vector));
  const rest = add(along, add(vector, along, -1), Math.cos(angle));
  return add(rest, cross(axis, vector), Math.sin(angle));
};

// A camera that turns about a target, moves along the picture, and comes nearer to what is under the cursor.
export class Orbit {
  constructor(camera, size) {
    Object.assign(this, { ...camera, size });
    if (this.ortho != null) this.fov = null;
    this.first = this.span();
  }

  // The camera that a picture was drawn with, about the target of what was asked for or the middle of the data.
  static of({ view, fov, extent }, { camera, bounds, kind }, size) {
    const { eye, forward, up: upright } = view;
    const middle = bounds && scaled(add(bounds[0], bounds[1]), 0.5);
    const center = camera?.target ?? middle ?? add(eye, forward);
    let away = dot(add(center, eye, -1), forward);
    if (!(away > 0)) away = bounds ? Math.hypot(...add(bounds[1], bounds[0], -1)) : 1;
    let up = camera?.up ?? (kind === "heights" ? [0, 0, 1] : [0, 1, 0]);
    const across = add(up, forward, -dot(up, forward));
    const length = Math.hypot(...across);
    if (length < Math.sin(POLE) * Math.hypot(...up) || dot(across, upright) < 0.999 * length) up = upright;
    const ortho = extent ? extent[3] - extent[2] : null;
    return new Orbit({ eye, target: add(eye, forward, away), up, fov, ortho }, size);
  }

  camera() {
    const { eye, target, up, fov, ortho } = this;
    return ortho == null ? { eye, target, up, fov } : { eye, target, up, ortho };
  }

  axes() {
    const forward = unit(add(this.target, this.eye, -1));
    const right = unit(cross(forward, this.up));
    return [right, cross(right, forward)];
  }

  span() {
    if (this.ortho != null) return this.ortho;
    return 2 * Math.hypot(...add(this.target, this.eye, -1)) * Math.tan((this.fov * Math.PI) / 360);
  }

  pixel() {
    return this.span() / this.size[1];
  }

  place(x, y) {
    const [right, up] = this.axes();
    const [width, height] = this.size;
    return add(add(this.target, right, this.pixel() * (x - width / 2)), up, this.pixel() * (height / 2 - y));
  }

  turn(x, y) {
    const [right] = this.axes();
    const [offset, axis] = [add(this.eye, this.target, -1), unit(this.up)];
    const distance = Math.hypot(...offset);
    const pole = Math.acos(clamp(dot(offset, axis) / distance, -1, 1));
    const least = Math.min(POLE, pole, Math.PI - pole);
    const lifted = clamp(pole - (y * Math.PI) / this.size[1], least, Math.PI - least) - pole;
    const after = turned(turned(offset, right, lifted), axis, (-x * Math.PI) / this.size[1]);
    this.eye = add(this.target, unit(after), distance);
  }

  pan(x, y) {
    const [right, up] = this.axes();
    const moved = add(scaled(up, this.pixel() * y), right, -this.pixel() * x);
    [this.eye, this.target] = [add(this.eye, moved), add(this.target, moved)];
  }

  zoom(factor, x, y) {
    const by = clamp(factor, (SPAN[0] * this.first) / this.span(), (SPAN[1] * this.first) / this.span());
    const fixed = this.place(x, y);
    [this.eye, this.target] = [this.eye, this.target].map((place) => add(fixed, add(place, fixed, -1), by));
    if (this.ortho != null) this.ortho *= by;
  }
}

// Something newer was asked for.
class Superseded extends Error {}

// There is no answer now, but may be later.
class Away extends Error {}

// What the server answers.
async function answered(path, options) {
  const response = await fetch(path, options).catch((error) => {
    if (error.name === "AbortError") throw error;
    throw new Away("the server does not answer: this page tries again by itself");
  });
  if (response.ok) return response;
  if (response.status === 409) throw new Superseded();
  const text = await response.text();
  // Where it is no JSON, it is a line for people.
  const why = text.startsWith("{") ? JSON.parse(text).error : text;
  throw response.status === 503 ? new Away(why) : new Error(why);
}

function ask(path, request, signal) {
  const headers = { "content-type": "application/json" };
  return answered(path, { method: "POST", headers, body: JSON.stringify(request), signal });
}

async function picture(request, signal) {
  const response = await ask("view/frame", request, signal);
  const facts = JSON.parse(response.headers.get("x-deepfield-facts"));
  return [facts, await response.arrayBuffer(), response.headers.get("content-type")];
}

// What the widget has in a notebook: it takes its messages, and sends it pictures and answers.
class Model {
  constructor(about, size) {
    const names = { attributes: about.fields, times: about.steps ?? [], time: null, flat: about.kind === "image" };
    this.about = { ...about, ...names, size };
    this.look = { mode: about.mode, attribute: null, time: null, colors: null, color_map: null, color_scale: null };
    this.start = about.camera;
    this.effort = 1 / 16;
    this.version = 0;
    this.coarse = this.finished = -1;
    this.picks = [];
    this.isOfTour = false;
    [this.delay] = AGAIN;
  }

  get(name) {
    return this[name];
  }

  on(_, receive) {
    this.receive = receive;
  }

  off() {
    this.receive = () => {};
  }

  send(message) {
    const { orbit } = this;
    if (message.do === "choose") {
      for (const name of Object.keys(this.look)) if (name in message) this.look[name] = message[name];
    } else if (message.do === "home") {
      this.orbit = null;
      this.start = this.about.camera;
    } else if (message.do === "pick") {
      this.picks.push(message);
    } else if (orbit) {
      if (message.do === "turn") orbit.turn(message.x, message.y);
      else if (message.do === "pan") orbit.pan(message.x, message.y);
      else if (message.do === "zoom") orbit.zoom(message.factor, message.x, message.y);
    }
    if (message.do !== "pick") this.renew();
    this.work();
  }

  // A viewpoint of the scene.
  goTo(camera) {
    this.orbit = new Orbit(camera, this.about.size);
    this.renew();
    this.work();
  }

  renew() {
    this.tour = null;
    this.isOfTour = false;
    this.version += 1;
    this.since = performance.now();
    this.stop?.abort();
    this.wake?.();
    this.receive({ kind: "moved" }, []);
  }

  // Waits so many milliseconds, or until there is something new to do.
  wait(milliseconds) {
    return new Promise((done) => {
      this.wake = done;
      setTimeout(done, milliseconds);
    });
  }

  // Does what is asked for, newest first, until all is done.
  async work() {
    if (this.working) return;
    this.working = true;
    while (true) {
      const { version } = this;
      try {
        if (this.tour != null) await this.play();
        else if (this.coarse !== version) await this.draw(version, true);
        else if (this.picks.length) await this.pick(this.picks.shift());
        else if (this.finished === version) break;
        else if (performance.now() < this.since + REST) await this.wait(this.since + REST - performance.now());
        else await this.draw(version, false);
      } catch (error) {
        const isOld = error instanceof Superseded || error.name === "AbortError";
        if (!isOld) this.receive({ kind: "error", text: error.message }, []);
        if (this.version !== version) continue;
        if (isOld || error instanceof Away) {
          // Pages of one visitor, who gets one picture at a time, take turns: by chance, and ever more patiently.
          await this.wait(this.delay * (0.5 + Math.random()));
          this.delay = Math.min(2 * this.delay, AGAIN[1]);
        } else {
          // This view would fail again.
          this.coarse = this.finished = version;
          this.tour = null;
        }
      }
    }
    this.working = false;
  }

  async draw(version, isMoving) {
    const [side, { size }] = [isMoving ? Math.sqrt(this.effort) : 1, this.about];
    const scale = Math.max(side, SMALLEST);
    const own = size.map((pixels) => Math.max(1, Math.round(scale * pixels)));
    const camera = this.orbit ? this.orbit.camera() : (this.start && this.asStarted()) ?? {};
    const format = isMoving && scale < 1 ? "jpeg" : "png";
    const request = { ...this.look, camera, size: own, error_px: ERROR_PX * (scale / side), format };
    // Coarse pictures are shown even when they are late: the view would stand still while it moves.
    this.stop = isMoving ? null : new AbortController();
    const begun = performance.now();
    const [facts, bytes, type] = await picture(request, this.stop?.signal);
    const seconds = (performance.now() - begun) / 1000;
    if (isMoving) {
      const least = (SMALLEST / COARSEST) ** 2;
      this.effort = clamp(this.effort * clamp(BUDGET / Math.max(seconds, 1e-6), 0.25, 2), least, 1);
    }
    const asked = { ...this.about, camera: this.start };
    if (!this.orbit && this.version === version) this.orbit = Orbit.of(facts, asked, size);
    this.coarse = version;
    const isFinished = !isMoving || side === 1;
    if (isFinished) this.finished = version;
    this.show(facts, bytes, type, isFinished, 1000 * seconds);
  }

  asStarted() {
    const { eye, target, up, fov, ortho } = this.start;
    return ortho == null ? { eye, target, up, fov } : { eye, target, up, ortho };
  }

  show(facts, bytes, type, finished, milliseconds) {
    [this.delay] = AGAIN;
    const [span, unit] = [this.orbit?.span(), facts.unit ?? this.about.unit];
    this.receive({ ...facts, kind: "frame", type, finished, span, unit, milliseconds }, [bytes]);
  }

  // Plays the tour from its beginning.
  begin() {
    this.renew();
    this.tour = performance.now();
    this.work();
  }

  // The tour goes on with the clock, however many pictures of it there are.
  async play() {
    const begun = performance.now();
    const time = Math.min((begun - this.tour) / 1000, this.about.tour);
    const isLast = time === this.about.tour;
    const size = this.about.size.map((pixels) => (isLast ? pixels : Math.max(1, Math.round(pixels / 2))));
    const [facts, bytes, type] = await picture({ tour: time, size, format: isLast ? "png" : "jpeg" });
    if (this.tour == null) return;
    this.show(facts, bytes, type, isLast, performance.now() - begun);
    this.isOfTour = true;
    // The last picture stays until somebody moves.
    if (isLast) {
      this.tour = null;
      this.coarse = this.finished = this.version;
    }
  }

  async pick({ x, y }) {
    if (!this.orbit) return;
    if (this.isOfTour) throw new Error("what is where in a tour's picture is not known: turn it, or choose a view");
    const { size } = this.about;
    const [place, radius] = [this.orbit.place(x, y), PICKED * this.orbit.pixel()];
    const request = { at: [x / size[0], y / size[1]], place, radius, time: this.look.time };
    const found = await (await ask("view/pick", request)).json();
    this.receive({ ...found, kind: "picked", place, radius, unit: this.about.unit }, []);
  }
}

const button = (text, onclick) => Object.assign(document.createElement("button"), { textContent: text, onclick });

async function begin() {
  const [view, more, state] = ["view", "more", "state"].map((id) => document.getElementById(id));
  let about;
  try {
    about = await (await answered("view/about")).json();
  } catch (error) {
    state.textContent = error.message;
    if (error instanceof Away) setTimeout(() => location.reload(), 30000);
    return;
  }
  const colors = document.createElement("select");
  for (const name of ["", ...about.colors]) colors.append(new Option(name || "usual", name));
  colors.onchange = () => model.send({ do: "choose", colors: colors.value || null });
  const label = document.createElement("label");
  label.append("colours ", colors);
  more.append(label);
  for (const { key, name, camera } of about.bookmarks ?? []) {
    more.append(button(name || `view ${key}`, () => model.goTo(camera)));
  }
  if (about.tour != null) more.append(button("tour", () => model.begin()));
  state.remove();
  // What is above and below the picture fits into the window, too.
  const rest = view.getBoundingClientRect().top + (window.innerWidth < 700 ? 180 : 84);
  const sides = [clamp(window.innerWidth - 24, 240, 1600), clamp(window.innerHeight - rest, 240, 1200)];
  const model = new Model(about, sides.map(Math.round));
  widget.render({ model, el: view });
  // Who looks without moving keeps the place; who leaves gives it away.
  setInterval(() => document.visibilityState === "visible" && fetch("view/about").catch(() => {}), SIGN);
  addEventListener("pagehide", () => navigator.sendBeacon("view/leave"));
}

begin();
