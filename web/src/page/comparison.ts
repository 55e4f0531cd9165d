// The picture with its layers compared with the picture without them: by blinking, and by a dividing line.

import { h } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import type { ViewState } from "../model/state.ts";
import type { Actions } from "./actions.ts";
import { Slider, button, row } from "./fields.ts";

/** Twice a second there, twice away. */
const BLINK_MS = 250;

export class Comparison {
  readonly element: HTMLElement;
  readonly #actions: Actions;
  readonly #redraw: () => void;
  readonly #blink: HTMLButtonElement;
  readonly #swipe: HTMLButtonElement;
  readonly #place: Slider;
  #share: number | null = null;
  #isHidden = false;
  #timer = 0;

  constructor(actions: Actions, redraw: () => void) {
    this.#actions = actions;
    this.#redraw = redraw;
    this.#blink = button(t("layer.blink"), () => this.#toggleBlink(), { "aria-pressed": "false" });
    this.#swipe = button(t("layer.swipe"), () => this.swipe(), { "aria-pressed": "false" });
    this.#place = new Slider("swipe-place", t("layer.divider"), [0, 1, 0.01], (share) =>
      actions.change({ swipe: { share } }),
    );
    this.element = h("div", { class: "group-part", hidden: true }, row(this.#blink, this.#swipe), this.#place.element);
  }

  /** Whether the layers are hidden for now. */
  get isHidden(): boolean {
    return this.#isHidden;
  }

  show({ layer, overlay, swipe }: ViewState): void {
    this.element.hidden = !layer && !overlay;
    if (this.element.hidden) this.stop();
    this.#share = swipe && swipe.share;
    this.#swipe.setAttribute("aria-pressed", String(swipe !== null));
    this.#place.element.hidden = !swipe;
    if (swipe) this.#place.show(swipe.share, `${number(100 * swipe.share)} %`);
  }

  /** Hides the layers, or shows them again. */
  hide(isHidden: boolean): void {
    if (isHidden === this.#isHidden) return;
    this.#isHidden = isHidden;
    this.#redraw();
  }

  /** Puts the dividing line into the middle, or takes it away. */
  swipe(): void {
    this.#actions.change({ swipe: this.#share === null ? { share: 0.5 } : null }, true);
  }

  /** The layers are shown, and stay. */
  stop(): void {
    clearInterval(this.#timer);
    this.#timer = 0;
    this.#blink.setAttribute("aria-pressed", "false");
    this.hide(false);
  }

  #toggleBlink(): void {
    if (this.#timer !== 0) return this.stop();
    this.#blink.setAttribute("aria-pressed", "true");
    this.#timer = window.setInterval(() => this.hide(!this.#isHidden), BLINK_MS);
  }
}
