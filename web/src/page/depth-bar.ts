// The bar below the picture: the depth, its steps and the sweep.

import type { ReadyCase } from "../model/case.ts";
import { depthOfShare, shareOfDepth, ticksTo } from "../model/depth-scale.ts";
import { DEPTH_STEP_MM, FINE_DEPTH_STEP_MM, GOOD_DEPTHS_MM, clampDepth, stepDepth } from "../model/state.ts";
import { h, icon, iconButton, setValue } from "../base/dom.ts";
import { number, numberUpTo, readNumber, t } from "../base/i18n.ts";
import type { Actions } from "./actions.ts";

/** The slider's own numbers: its places, not millimetres, for its two halves are of different scales. */
const PLACES = 1000;
/** What is written also beside a short slider. */
const MAJOR_TICKS_MM: readonly number[] = [0, ...GOOD_DEPTHS_MM, 40];
/** What the keys of a slider do, in steps of the depth. */
const KEYS: Readonly<Record<string, number>> = {
  ArrowRight: 1,
  ArrowUp: 1,
  ArrowLeft: -1,
  ArrowDown: -1,
  PageUp: -10,
  PageDown: 10,
};

export class DepthBar {
  readonly element: HTMLElement;
  readonly #deepest: number;
  readonly #range: HTMLInputElement;
  readonly #number: HTMLInputElement;
  readonly #play: HTMLButtonElement;
  #depth = 0;
  #isTyping = false;
  #playing: boolean | null = null;

  constructor(shown: ReadyCase, actions: Actions) {
    const deepest = clampDepth(Infinity, shown);
    this.#deepest = deepest;
    const take = (depth_mm: number): void => {
      if (Number.isFinite(depth_mm)) actions.change({ depth_mm: clampDepth(depth_mm, shown) });
    };
    this.#range = h("input", {
      type: "range",
      id: "depth",
      min: 0,
      max: PLACES,
      step: 1,
      "aria-label": t("depth.label"),
      input: () => {
        const depth = depthOfShare(this.#range.valueAsNumber / PLACES, deepest);
        take(Math.round(depth / DEPTH_STEP_MM) * DEPTH_STEP_MM);
      },
      keydown: (event: KeyboardEvent) => {
        const steps = KEYS[event.key];
        const ends = { Home: 0, End: deepest }[event.key];
        if ((steps === undefined && ends === undefined) || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        event.stopPropagation();
        take(ends ?? stepDepth(this.#depth, steps ?? 0, DEPTH_STEP_MM));
      },
    });
    this.#number = h("input", {
      // "change", not "input": a number is not corrected while it is being typed. A box for numbers alone would write
      // them in the browser's language, not in the page's.
      type: "text",
      inputmode: "decimal",
      id: "depth-number",
      "aria-label": t("depth.number"),
      input: () => (this.#isTyping = true),
      change: () => {
        take(readNumber(this.#number.value));
        this.#leave();
      },
      keydown: (event: KeyboardEvent) => {
        if (event.key === "Escape") this.#leave();
        if (event.key === "Enter") this.#number.blur();
        const steps = { ArrowUp: 1, ArrowDown: -1 }[event.key];
        if (steps === undefined) return;
        event.preventDefault();
        this.#isTyping = false;
        take(stepDepth(this.#depth, steps, FINE_DEPTH_STEP_MM));
      },
      // An empty box has no change to tell of.
      blur: () => this.#leave(),
    });
    this.#play = h("button", { class: "icon-button play", click: () => actions.command({ kind: "play" }) });
    const step = (steps: number): void => actions.command({ kind: "depth", steps, fine: false });
    this.element = h(
      "div",
      { class: "depth-bar", role: "group", "aria-label": t("depth.label") },
      this.#play,
      iconButton("minus", t("depth.less"), () => step(-1)),
      h("div", { class: "depth-track" }, this.#goodDepths(), this.#range, this.#ticks()),
      iconButton("plus", t("depth.more"), () => step(1)),
      this.#number,
      h("span", { class: "unit" }, "mm"),
    );
    this.show(0, false);
  }

  show(depth_mm: number, playing: boolean): void {
    this.#range.setAttribute("aria-valuetext", `${number(depth_mm, 1)} mm`);
    setValue(this.#range, Math.round(PLACES * shareOfDepth(depth_mm, this.#deepest)));
    this.#depth = depth_mm;
    if (!this.#isTyping) this.#leave();
    if (playing === this.#playing) return;
    this.#playing = playing;
    const label = t(playing ? "depth.pause" : "depth.play");
    this.#play.replaceChildren(icon(playing ? "pause" : "play"));
    this.#play.setAttribute("aria-label", label);
    this.#play.title = label;
  }

  /** The box says the depth again: what was typed may be out of range, or no number. */
  #leave(): void {
    this.#isTyping = false;
    this.#number.value = numberUpTo(this.#depth, 2);
  }

  /** The depths at which most sulci are cut across. */
  #goodDepths(): HTMLElement {
    const [from, to] = GOOD_DEPTHS_MM.map((depth) => shareOfDepth(Math.min(depth, this.#deepest), this.#deepest));
    const band = h("span", { class: "good-depths", title: t("depth.good") });
    band.style.setProperty("--from", String(from));
    band.style.setProperty("--to", String(to));
    return band;
  }

  #ticks(): HTMLElement {
    const ticks = ticksTo(this.#deepest).map((depth) => {
      const tick = h("span", { class: MAJOR_TICKS_MM.includes(depth) ? null : "minor" }, number(depth));
      tick.style.setProperty("--at", String(shareOfDepth(depth, this.#deepest)));
      return tick;
    });
    return h("div", { class: "depth-ticks", "aria-hidden": "true" }, ...ticks);
  }
}

/** A line for those who see the depth slider for the first time; `dismissed` is called when it is taken away. */
export function explanation(dismissed: () => void): HTMLElement {
  const dismiss = (): void => {
    element.remove();
    dismissed();
  };
  const element = h(
    "div",
    { class: "notice-line remark first-time", role: "note" },
    h("span", {}, t("depth.first-time")),
    iconButton("close", t("notice.dismiss"), dismiss),
  );
  return element;
}
