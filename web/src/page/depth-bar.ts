// The bar below the picture: the depth, its steps and the sweep.

import type { ReadyCase } from "../model/case.ts";
import { DEPTH_STEP_MM, clampDepth } from "../model/state.ts";
import { h, icon, iconButton, setValue } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import type { Actions } from "./actions.ts";

export class DepthBar {
  readonly element: HTMLElement;
  readonly #range: HTMLInputElement;
  readonly #number: HTMLInputElement;
  readonly #play: HTMLButtonElement;
  /** What the number is to say. */
  #depth = "";
  #playing: boolean | null = null;

  constructor(shown: ReadyCase, actions: Actions) {
    const deepest = clampDepth(Infinity, shown);
    const take = (input: HTMLInputElement): void => {
      if (Number.isFinite(input.valueAsNumber)) actions.change({ depth_mm: clampDepth(input.valueAsNumber, shown) });
    };
    this.#range = h("input", {
      type: "range",
      id: "depth",
      min: 0,
      max: deepest,
      step: DEPTH_STEP_MM,
      "aria-label": t("depth.label"),
      input: () => take(this.#range),
    });
    this.#number = h("input", {
      // "change", not "input": a number is not corrected while it is being typed.
      type: "number",
      id: "depth-number",
      min: 0,
      max: deepest,
      step: 0.1,
      "aria-label": t("depth.number"),
      change: () => {
        take(this.#number);
        // What was typed may be out of range, or no number.
        this.#number.value = this.#depth;
      },
      keydown: (event: KeyboardEvent) => {
        if (event.key === "Enter") this.#number.blur();
      },
      // An empty box has no change to tell of.
      blur: () => (this.#number.value = this.#depth),
    });
    this.#play = h("button", {
      type: "button",
      class: "icon-button play",
      click: () => actions.command({ kind: "play" }),
    });
    const step = (steps: number): void => actions.command({ kind: "depth", steps, fine: false });
    this.element = h(
      "div",
      { class: "depth-bar", role: "group", "aria-label": t("depth.label") },
      this.#play,
      iconButton("minus", t("depth.less"), () => step(-1)),
      this.#range,
      iconButton("plus", t("depth.more"), () => step(1)),
      this.#number,
      h("span", { class: "unit" }, "mm"),
    );
    this.show(0, false);
  }

  show(depth_mm: number, playing: boolean): void {
    this.#range.setAttribute("aria-valuetext", `${number(depth_mm, 1)} mm`);
    setValue(this.#range, depth_mm);
    this.#depth = String(Number(depth_mm.toFixed(2)));
    setValue(this.#number, this.#depth);
    if (playing === this.#playing) return;
    this.#playing = playing;
    const label = t(playing ? "depth.pause" : "depth.play");
    this.#play.replaceChildren(icon(playing ? "pause" : "play"));
    this.#play.setAttribute("aria-label", label);
    this.#play.title = label;
  }
}
