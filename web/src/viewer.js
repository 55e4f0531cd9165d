// The chosen case: its picture, the six views, a slice, and the controls that alter the scene.

import { getPicture } from "./api.js";
import { Picture } from "./picture.js";
import {
  DEPTH_STEP_MM, PLANES, VIEWS, clampDepth, deepest, firstScene, pictureSize, renderQuery, sliceQuery, sliceRange,
} from "./scene.js";

const STRIP_PIXELS = 128;
/** The strip and the slice wait until the depth has rested this long, so that the large picture comes first. */
const REST_MS = 120;

const element = (id) => document.getElementById(id);

export class Viewer {
  #case = null;
  #scene = null;
  #rest = 0;
  #viewport = element("viewport");
  #sliceFrame = element("slice-frame");
  #render = new Picture(this.#viewport, getPicture);
  #slice = new Picture(this.#sliceFrame, getPicture);
  #strip = new Map();

  constructor() {
    this.#buildViews();
    this.#buildPlanes();
    this.#listenToDepth();
    this.#listenToColours();
    this.#listenToSlice();
    element("zoom").addEventListener("input", (event) => this.#alter({ zoom: event.target.valueAsNumber }));
    new ResizeObserver(() => this.#scene && this.#drawRender()).observe(this.#viewport);
  }

  /** Shows a ready case, or nothing for null; the scene stays while the case stays the same. */
  show(ready) {
    if (ready?.id === this.#case?.id) return;
    this.#case = ready;
    this.#scene = ready && firstScene(ready);
    if (ready) {
      this.#setRanges();
      this.#alter({});
    } else {
      clearTimeout(this.#rest);
      for (const picture of [this.#render, this.#slice, ...this.#strip.values()]) picture.clear();
    }
  }

  #alter(change) {
    if (!this.#scene) return;
    Object.assign(this.#scene, change);
    this.#showControls();
    this.#drawRender();
    clearTimeout(this.#rest);
    this.#rest = setTimeout(() => this.#drawTheRest(), REST_MS);
  }

  #drawRender() {
    const { view, depth_mm } = this.#scene;
    const size = pictureSize(this.#viewport.clientWidth, devicePixelRatio);
    this.#render.show(`${this.#case.id}/render?${renderQuery(this.#scene, view, size)}`, (image) => {
      const depth = depth_mm.toFixed(1);
      image.alt = `The cortex ${depth} mm below the dura, ${view} view`;
      element("depth-shown").textContent = `${depth} mm`;
      letter(this.#viewport, VIEWS[view].edges);
    });
  }

  #drawTheRest() {
    if (!this.#scene) return;
    const { plane, depth_mm } = this.#scene;
    const whole = { ...this.#scene, zoom: 1 };
    const size = pictureSize(STRIP_PIXELS, devicePixelRatio);
    for (const [view, picture] of this.#strip) {
      picture.show(`${this.#case.id}/render?${renderQuery(whole, view, size)}`, () => {});
    }
    this.#slice.show(`${this.#case.id}/slices/${plane}?${sliceQuery(this.#scene)}`, (image) => {
      image.alt = `${PLANES[plane].label} slice with the outline of the cut at ${depth_mm.toFixed(1)} mm`;
      letter(this.#sliceFrame, PLANES[plane].edges);
    });
  }

  #setRanges() {
    const { intensity } = this.#case;
    const range = intensity.max - intensity.min || 1;
    for (const id of ["depth", "depth-number"]) element(id).max = deepest(this.#case);
    setRange("window-center", intensity.min, intensity.max, range / 500);
    setRange("window-width", range / 500, range, range / 500);
    this.#setPositionRange();
  }

  #setPositionRange() {
    const { min, max } = sliceRange(this.#case.grid, this.#scene.plane);
    Object.assign(element("position"), { min, max });
  }

  #showControls() {
    const scene = this.#scene;
    setValue("depth", scene.depth_mm);
    setValue("depth-number", scene.depth_mm.toFixed(1));
    setValue("zoom", scene.zoom);
    for (const side of ["center", "width"]) {
      setValue(`window-${side}`, scene.window[side]);
      setValue(`window-${side}-number`, Number(scene.window[side].toPrecision(4)));
    }
    setValue("colormap", scene.colormap);
    setValue("position", scene.position_mm);
    element("position-shown").textContent = `${scene.position_mm.toFixed(1)} mm`;
    press("views", scene.view);
    press("strip", scene.view);
    press("planes", scene.plane);
  }

  #buildViews() {
    for (const [view, { label, edges }] of Object.entries(VIEWS)) {
      const choose = () => this.#alter({ view });
      element("views").append(makeButton(view, label, choose));
      const thumb = makeButton(view, "", choose);
      thumb.title = label;
      thumb.setAttribute("aria-label", `${label} view`);
      thumb.classList.add("frame");
      thumb.appendChild(new Image());
      for (const side of Object.keys(edges)) {
        thumb.appendChild(document.createElement("span")).className = `edge ${side}`;
      }
      letter(thumb, edges);
      element("strip").append(thumb);
      this.#strip.set(view, new Picture(thumb, getPicture));
    }
  }

  #buildPlanes() {
    for (const [plane, { label }] of Object.entries(PLANES)) {
      const choose = () => {
        if (!this.#scene) return;
        this.#scene.plane = plane;
        this.#setPositionRange();
        this.#alter({ position_mm: sliceRange(this.#case.grid, plane).middle });
      };
      element("planes").append(makeButton(plane, label, choose));
    }
  }

  #setDepth(depth_mm) {
    if (this.#case) this.#alter({ depth_mm: clampDepth(depth_mm, this.#case) });
  }

  #listenToDepth() {
    element("depth").addEventListener("input", (event) => this.#setDepth(event.target.valueAsNumber));
    // "change", not "input": a number is not corrected while it is being typed.
    element("depth-number").addEventListener("change", (event) => this.#setDepth(event.target.valueAsNumber));
    onWheel(this.#viewport, (steps) => this.#setDepth(this.#scene.depth_mm + steps * DEPTH_STEP_MM));
    const steps = { ArrowUp: -1, ArrowDown: 1, PageUp: -10, PageDown: 10, Home: -Infinity, End: Infinity };
    this.#viewport.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !this.#scene) return;
      const view = Object.keys(VIEWS).find((name) => VIEWS[name].key === event.key.toLowerCase());
      if (view) this.#alter({ view });
      else if (event.key in steps) this.#setDepth(this.#scene.depth_mm + steps[event.key] * DEPTH_STEP_MM);
      else return;
      event.preventDefault();
    });
  }

  #listenToColours() {
    const setWindow = (change) => this.#scene && this.#alter({ window: { ...this.#scene.window, ...change } });
    for (const side of ["center", "width"]) {
      const take = (event) => {
        const value = event.target.valueAsNumber;
        const good = Number.isFinite(value) && (side === "center" || value > 0);
        setWindow(good ? { [side]: value } : {});
      };
      element(`window-${side}`).addEventListener("input", take);
      element(`window-${side}-number`).addEventListener("change", take);
    }
    element("window-reset").addEventListener("click", () => {
      if (this.#case) this.#alter({ window: { ...firstScene(this.#case).window }, colormap: "grey" });
    });
    element("colormap").addEventListener("change", (event) => this.#alter({ colormap: event.target.value }));
  }

  #listenToSlice() {
    const setPosition = (position_mm) => {
      const { min, max } = sliceRange(this.#case.grid, this.#scene.plane);
      this.#alter({ position_mm: Math.min(Math.max(position_mm, min), max) });
    };
    element("position").addEventListener("input", (event) => this.#scene && setPosition(event.target.valueAsNumber));
    onWheel(this.#sliceFrame, (steps) => this.#scene && setPosition(this.#scene.position_mm - steps));
  }
}

function makeButton(value, label, onClick) {
  const button = document.createElement("button");
  button.type = "button";
  button.value = value;
  button.textContent = label;
  button.addEventListener("click", onClick);
  return button;
}

/** Marks the chosen one of a group of buttons. */
function press(group, value) {
  for (const button of element(group).querySelectorAll("button")) {
    button.setAttribute("aria-pressed", String(button.value === value));
  }
}

/** Puts the patient's directions at the edges of a frame. */
function letter(frame, edges) {
  for (const [side, text] of Object.entries(edges)) frame.querySelector(`.edge.${side}`).textContent = text;
}

/** Sets the range of a slider and of the number beside it. */
function setRange(id, min, max, step) {
  Object.assign(element(id), { min, max, step });
}

/** Sets a control's value, unless the user is typing into it. */
function setValue(id, value) {
  const control = element(id);
  if (control.type !== "number" || document.activeElement !== control) control.value = value;
}

/** `onSteps` hears whole notches of the wheel, also from touchpads that send many small movements. */
function onWheel(target, onSteps) {
  const NOTCH = 60;
  let moved = 0;
  target.addEventListener("wheel", (event) => {
    if (event.ctrlKey) return;
    event.preventDefault();
    moved += event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? event.deltaY : event.deltaY * NOTCH;
    const steps = Math.trunc(moved / NOTCH);
    moved -= steps * NOTCH;
    if (steps !== 0) onSteps(steps);
  }, { passive: false });
}
