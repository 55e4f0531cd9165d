// The section of the panel for the maps: which of them lies over the picture, how, and a list of places to look at.

import { h, setText, setValue } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import { positionWords } from "../base/readout.ts";
import type { ReadyCase } from "../model/case.ts";
import { broughtTo } from "../model/commands.ts";
import {
  type Candidate,
  MAP_NAMES,
  type MapName,
  type MapOverlay,
  type MapsState,
  THRESHOLD_RANGE,
  styleOf,
} from "../model/maps.ts";
import type { Layout, ViewState } from "../model/state.ts";
import type { Actions } from "./actions.ts";
import type { CaseMaps } from "./case-maps.ts";
import { button, line, press, row } from "./fields.ts";

/** What opens beside the surface when a place is gone to. */
const BESIDE = ["slices", "mirror"] as const satisfies readonly Layout[];

export class MapsSection {
  readonly element: HTMLElement;
  readonly #shown: ReadyCase;
  readonly #maps: CaseMaps;
  readonly #actions: Actions;
  readonly #names: HTMLElement;
  readonly #about = h("p", { class: "quiet", hidden: true });
  readonly #status = h("p", { class: "quiet maps-status", role: "status", hidden: true });
  readonly #threshold: HTMLInputElement;
  readonly #thresholdText = h("span", { class: "value quiet", "aria-hidden": "true" });
  readonly #thresholdLine: HTMLElement;
  readonly #opacity: HTMLInputElement;
  readonly #opacityText = h("span", { class: "value quiet", "aria-hidden": "true" });
  readonly #opacityLine: HTMLElement;
  readonly #ask: HTMLButtonElement;
  readonly #warning = h("p", { class: "candidates-warning", hidden: true }, t("candidates.warning"));
  readonly #list = h("ol", { class: "candidates", hidden: true });
  #candidates: readonly Candidate[] = [];
  #state: ViewState | null = null;

  constructor(shown: ReadyCase, maps: CaseMaps, actions: Actions) {
    this.#shown = shown;
    this.#maps = maps;
    this.#actions = actions;
    this.#names = h(
      "div",
      { class: "buttons", role: "group", "aria-label": t("map.label") },
      button(t("map.none"), () => actions.change({ overlay: null }, true), { value: "", "aria-pressed": "false" }),
      ...MAP_NAMES.map((name) =>
        button(t(`map.${name}`), () => this.#choose(name), { value: name, "aria-pressed": "false" }),
      ),
    );
    this.#threshold = this.#slider("map-threshold", t("map.threshold"), THRESHOLD_RANGE, 0.1, (threshold) => ({
      threshold,
    }));
    this.#opacity = this.#slider("map-opacity", t("map.opacity"), [0, 1], 0.05, (opacity) => ({ opacity }));
    this.#thresholdLine = line(t("map.threshold"), this.#threshold, this.#thresholdText);
    this.#opacityLine = line(t("map.opacity"), this.#opacity, this.#opacityText);
    this.#ask = button(t("candidates.ask"), () => void this.#askForCandidates());
    this.element = h(
      "div",
      { class: "group-body" },
      this.#names,
      this.#about,
      this.#thresholdLine,
      this.#opacityLine,
      row(this.#ask),
      this.#status,
      this.#warning,
      this.#list,
    );
  }

  show(state: ViewState): void {
    this.#state = state;
    const { overlay } = state;
    press(this.#names, overlay?.name ?? "");
    this.#about.hidden = this.#opacityLine.hidden = overlay === null;
    this.#thresholdLine.hidden = overlay === null || overlay.threshold === null;
    this.#mark();
    if (!overlay) return;
    setText(this.#about, t(`map.${overlay.name}.about`));
    setValue(this.#opacity, overlay.opacity);
    this.#write(this.#opacity, this.#opacityText, `${number(100 * overlay.opacity)} %`);
    if (overlay.threshold === null) return;
    setValue(this.#threshold, overlay.threshold);
    this.#write(this.#threshold, this.#thresholdText, `${number(overlay.threshold, 1)} ${styleOf(overlay.name).unit}`);
  }

  /** Says how far the maps are. */
  tell(now: MapsState): void {
    this.#say(now.state === "ready" ? "" : "reason" in now && now.reason ? reasonWords(now) : t(`maps.${now.state}`));
  }

  #say(words: string): void {
    setText(this.#status, words);
    this.#status.hidden = words === "";
  }

  #write(input: HTMLInputElement, text: HTMLElement, words: string): void {
    input.setAttribute("aria-valuetext", words);
    setText(text, words);
  }

  /** Shows a map; one that is shown already stays. */
  #choose(name: MapName): void {
    if (this.#state?.overlay?.name !== name) this.#actions.command({ kind: "map", name });
  }

  #slider(
    id: string,
    label: string,
    [min, max]: readonly [number, number],
    step: number,
    change: (value: number) => Partial<MapOverlay>,
  ): HTMLInputElement {
    const input = h("input", {
      type: "range",
      id,
      min,
      max,
      step,
      "aria-label": label,
      input: () => {
        const overlay = this.#state?.overlay;
        if (overlay) this.#actions.change({ overlay: { ...overlay, ...change(input.valueAsNumber) } });
      },
    });
    return input;
  }

  // -- Places to look at

  async #askForCandidates(): Promise<void> {
    this.#ask.disabled = true;
    this.#say(t("maps.asking"));
    try {
      await this.#maps.ask();
      if (this.#maps.isReady) this.#put(await this.#maps.candidates());
    } catch (problem) {
      this.#say(problemWords(problem));
    }
    this.#ask.disabled = false;
  }

  #put(candidates: readonly Candidate[]): void {
    this.#say(candidates.length === 0 ? t("candidates.none") : "");
    this.#candidates = candidates;
    this.#warning.hidden = this.#list.hidden = candidates.length === 0;
    this.#list.replaceChildren(...candidates.map((one, at) => this.#item(one, at)));
    this.#mark();
  }

  #item({ position_in_patient, depth_mm, side, score, size_mm }: Candidate, at: number): HTMLElement {
    const go = (layout: Layout | null): void =>
      this.#actions.change(
        broughtTo(position_in_patient, depth_mm, layout ?? this.#state?.layout ?? "single", this.#shown),
        true,
      );
    const place = t("candidates.place", { rank: number(at + 1), side: t(`side.${side}`), depth: number(depth_mm, 1) });
    const facts = t("candidates.facts", { score: number(score, 1), size: number(size_mm, 1) });
    return h(
      "li",
      {},
      button(place, () => go(null), { class: "candidate" }),
      ...BESIDE.map((layout) =>
        button(t(`candidates.${layout}`), () => go(layout), { "aria-label": `${place}: ${t(`layout.${layout}`)}` }),
      ),
      h("span", { class: "quiet" }, `${facts} · ${positionWords(position_in_patient)}`),
    );
  }

  /** Marks the place that is gone to. */
  #mark(): void {
    const marked = this.#state?.crosshair_mm?.map((part) => part.toFixed(1)).join();
    for (const [at, item] of [...this.#list.children].entries()) {
      const isMarked = this.#candidates[at]?.position_in_patient.map((part) => part.toFixed(1)).join() === marked;
      item.setAttribute("aria-current", String(isMarked));
    }
  }
}

/** Why there are no maps. */
const reasonWords = (now: MapsState & { readonly reason?: string }): string =>
  t("maps.undefined", { reason: sentence(now.reason ?? "") });
