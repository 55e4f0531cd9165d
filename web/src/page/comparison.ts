// The picture with its layers compared with the picture without them: by blinking, and by a dividing line.

import { h } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { type HalfLook, type ViewState, halfOf, hasSlices, isMirrored } from "../model/state.ts";
import type { Actions } from "./actions.ts";
import { Slider, button, row } from "./fields.ts";

/** Twice a second there, twice away. */
const BLINK_MS = 250;

export class Comparison {
  readonly element: HTMLElement;
  readonly #actions: Actions;
  readonly #redraw: () => void;
  /** A state without its layers. */
  readonly #own: (state: ViewState) => HalfLook;
  readonly #blink: HTMLButtonElement;
  readonly #swipe: HTMLButtonElement;
  readonly #edges: HTMLButtonElement;
  readonly #beside: HTMLButtonElement;
  readonly #swap: HTMLButtonElement;
  readonly #place: Slider;
  #state: ViewState | null = null;
  #isHidden = false;
  #timer = 0;

  constructor(actions: Actions, redraw: () => void, own: (state: ViewState) => HalfLook) {
    this.#actions = actions;
    this.#redraw = redraw;
    this.#own = own;
    this.#blink = button(t("layer.blink"), () => this.#toggleBlink(), { "aria-pressed": "false" });
    this.#swipe = button(t("layer.swipe"), () => this.swipe(), { "aria-pressed": "false" });
    this.#edges = button(t("layer.edges"), () => this.edges(), { "aria-pressed": "false" });
    this.#beside = button(t("layer.beside"), () => this.beside(), { "aria-pressed": "false" });
    this.#swap = button(t("layer.swap"), () => this.swap());
    this.#place = new Slider("swipe-place", t("layer.divider"), [0, 1, 0.01], (share) =>
      actions.change({ swipe: { share } }),
    );
    this.element = h(
      "div",
      { class: "group-part", hidden: true },
      row(this.#blink, this.#swipe, this.#edges, this.#beside, this.#swap),
      this.#place.element,
    );
  }

  /** Whether the layers are hidden for now. */
  get isHidden(): boolean {
    return this.#isHidden;
  }

  show(state: ViewState): void {
    const { layer, overlay, beside, swipe, has_edges } = state;
    this.element.hidden = !layer && !overlay && !beside;
    if (this.element.hidden) this.stop();
    this.#state = state;
    this.#edges.setAttribute("aria-pressed", String(has_edges));
    this.#swipe.setAttribute("aria-pressed", String(swipe !== null));
    this.#beside.setAttribute("aria-pressed", String(beside !== null));
    // A close-up has its halves already.
    const isCloser = state.layout === "closer";
    this.#swipe.hidden = this.#beside.hidden = isCloser;
    this.#swap.hidden = !beside || isCloser;
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
    if (this.#state?.layout === "closer") return;
    this.#actions.change({ swipe: this.#state?.swipe ? null : { share: 0.5 }, beside: null }, true);
  }

  /** Shows the case without its layers in a left half, or no more. */
  beside(): void {
    const state = this.#state;
    if (!state || state.layout === "closer") return;
    if (state.beside) return this.#actions.change({ beside: null }, true);
    const layout = hasSlices(state) ? "slices" : "single";
    this.#actions.change({ beside: this.#own(state), layout, swipe: null }, true);
  }

  /** Exchanges what the two halves show: what is chosen is of the right one. */
  swap(): void {
    if (this.#state?.beside && this.#state.layout !== "closer")
      this.#actions.change({ ...this.#state.beside, beside: halfOf(this.#state) }, true);
  }

  /** Shows edges, on slices, or no more. */
  edges(): void {
    const state = this.#state;
    if (!state) return;
    const layout = isMirrored(state) ? "both" : "slices";
    const needsSlices = !state.has_edges && !hasSlices(state) && state.layout !== "closer";
    this.#actions.change({ has_edges: !state.has_edges, ...(needsSlices && { layout }) }, true);
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
