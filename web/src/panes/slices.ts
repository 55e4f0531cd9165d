// One slice with the outline of the cut, its cursor and its control.

import type { ReadyCase } from "../model/case.ts";
import { h, setText, setValue } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { Overlay } from "./overlay.ts";
import { FollowingPicture } from "../base/picture.ts";
import { PLANES, type Plane, pictureSize, sliceQuery } from "../model/query.ts";
import { Notches, wheelPixels } from "../model/controls.ts";
import {
  type SliceView,
  isFlipped,
  reachOf,
  sliceEdges,
  sliceMmPerPixel,
  slicePixel,
  slicePosition,
  withinReach,
} from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";

const MOST_PIXELS = 768;
/** A step of the wheel and of the arrows, in mm. */
const STEP_MM = 1;

export interface SliceListener {
  /** The cross is put here; `done` when the hand has left. */
  move(position_in_patient: Vec3, done: boolean): void;
  complain(problem: unknown): void;
}

export class SlicePane {
  readonly element: HTMLElement;
  readonly plane: Plane;
  readonly #shown: ReadyCase;
  readonly #listener: SliceListener;
  readonly #overlay: Overlay;
  readonly #picture: FollowingPicture<{ state: ViewState; view: SliceView }>;
  readonly #image = h("div", { class: "slice-image" });
  readonly #range: HTMLInputElement;
  readonly #words: HTMLElement;
  #state: ViewState | null = null;

  constructor(plane: Plane, shown: ReadyCase, listener: SliceListener) {
    this.plane = plane;
    this.#shown = shown;
    this.#listener = listener;
    const label = t(`plane.${plane}`);
    this.element = h(
      "section",
      { class: `pane slice ${plane}`, role: "group", tabindex: 0, "aria-label": t("slice.label", { plane: label }) },
      this.#image,
    );
    this.#overlay = new Overlay(this.element);
    const [min, max] = reachOf(shown, PLANES[plane].axis);
    this.#range = h("input", {
      type: "range",
      class: "slice-range",
      min,
      max,
      step: 0.5,
      "aria-label": t("slice.position", { plane: label }),
      input: () => this.#goTo(this.#range.valueAsNumber),
    });
    this.#words = h("p", { id: `slice-${plane}-words`, class: "visually-hidden" });
    this.element.setAttribute("aria-describedby", this.#words.id);
    this.element.append(this.#range, this.#words);
    this.#picture = new FollowingPicture({
      put: (image, { state, view }) => this.#put(image, state, view),
      complain: (problem) => {
        this.element.classList.toggle("troubled", problem !== null);
        listener.complain(problem);
      },
    });
    this.#listen();
  }

  /** Shows the slice through the state's cross, else through the middle of the head. */
  show(state: ViewState): void {
    this.#state = state;
    const view = this.#view(state);
    const query = sliceQuery(
      state,
      this.plane,
      this.#center(state),
      pictureSize(view.size, devicePixelRatio, MOST_PIXELS),
    );
    this.#picture.show(`${this.#shown.id}/slices/${this.plane}?${query}`, { state, view });
    this.#picture.again();
    setValue(this.#range, view.position_mm);
    // The convention and the cross are the page's own: they need no other picture.
    this.#write(state, view);
  }

  /** Says what is shown, for those who do not see it. */
  describe(words: string): void {
    setText(this.#words, `${this.#range.getAttribute("aria-valuetext") ?? ""}. ${words}`);
  }

  dispose(): void {
    this.#picture.stop();
  }

  #center(state: ViewState): Vec3 {
    return state.crosshair_mm ?? this.#shown.envelope_sphere.center_in_patient;
  }

  #view(state: ViewState): SliceView {
    const size: Vec2 = [this.element.clientWidth, this.element.clientHeight];
    return {
      plane: this.plane,
      convention: state.convention,
      position_mm: this.#center(state)[PLANES[this.plane].axis],
      size,
    };
  }

  #put(image: HTMLImageElement, state: ViewState, view: SliceView): void {
    image.alt = t("slice.alt", {
      plane: t(`plane.${this.plane}`),
      position: number(view.position_mm, 1),
      depth: number(state.depth_mm, 1),
    });
    this.#image.replaceChildren(image);
    this.element.dataset.position = String(view.position_mm);
    this.element.dataset.depth = String(state.depth_mm);
    this.#write(this.#state ?? state, this.#view(this.#state ?? state));
  }

  #write(state: ViewState, view: SliceView): void {
    const sphere = this.#shown.envelope_sphere;
    this.#image.classList.toggle("flipped", isFlipped(this.plane, state.convention));
    this.#overlay.letter(sliceEdges(this.plane, state.convention));
    const side = positionLetter(this.plane, view.position_mm);
    const badge = this.plane === "sagittal" ? "" : t(`convention.${state.convention}.badge`);
    this.#overlay.title(`${t(`plane.${this.plane}`)}  ${side} ${number(Math.abs(view.position_mm), 1)}`, badge);
    this.#overlay.scale(sliceMmPerPixel(view, sphere), view.size[0]);
    this.#overlay.cursor(state.crosshair_mm && slicePixel(view, sphere, state.crosshair_mm), view.size, "lines");
    this.#range.setAttribute("aria-valuetext", `${side} ${number(Math.abs(view.position_mm), 1)} mm`);
  }

  #goTo(position_mm: number, done = true): void {
    if (!this.#state) return;
    const position = this.#center(this.#state).map((value, axis) =>
      axis === PLANES[this.plane].axis ? position_mm : value,
    );
    this.#listener.move(withinReach(this.#shown, position as unknown as Vec3), done);
  }

  #step(steps: number): void {
    if (this.#state) this.#goTo(this.#center(this.#state)[PLANES[this.plane].axis] + steps * STEP_MM);
  }

  #listen(): void {
    let held = false;
    const place = (event: PointerEvent, done: boolean): void => {
      if (!this.#state) return;
      const box = this.element.getBoundingClientRect();
      const at: Vec2 = [event.clientX - box.left, event.clientY - box.top];
      const position = slicePosition(this.#view(this.#state), this.#shown.envelope_sphere, at);
      this.#listener.move(withinReach(this.#shown, position), done);
    };
    this.element.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || event.target === this.#range) return;
      held = true;
      this.element.setPointerCapture(event.pointerId);
      place(event, false);
    });
    this.element.addEventListener("pointermove", (event) => held && place(event, false));
    this.element.addEventListener("pointerup", (event) => {
      if (held) place(event, true);
      held = false;
    });
    this.element.addEventListener("pointercancel", () => (held = false));
    const notches = new Notches();
    this.element.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        // Away from the user is towards the head, the face and the patient's left, as the numbers grow on a slider.
        const steps = notches.take(wheelPixels(event));
        if (steps !== 0) this.#step(-steps);
      },
      { passive: false },
    );
    this.element.addEventListener("keydown", (event) => {
      if (event.target !== this.element || event.ctrlKey || event.metaKey || event.altKey) return;
      const steps = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (steps === undefined) return;
      this.#step(steps);
      event.preventDefault();
      event.stopPropagation();
    });
  }
}

const LETTERS = { axial: ["S", "I"], coronal: ["P", "A"], sagittal: ["L", "R"] } as const;
const positionLetter = (plane: Plane, position_mm: number): string => LETTERS[plane][position_mm < 0 ? 1 : 0];
