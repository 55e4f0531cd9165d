// The section of the panel for the maps: which of them lies over the picture, how, and a list of places to look at.

import { h, quiet, setText, tell } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { reasonIn } from "../base/case-words.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import { broughtTo } from "../model/commands.ts";
import type { Finding } from "../model/findings.ts";
import type { JunctionBand, Layer, LayerList } from "../model/layers.ts";
import { type Candidate, type CandidateList, MAP_NAMES, type MapName, isMap } from "../model/maps.ts";
import type { ViewState } from "../model/state.ts";
import type { Actions } from "./actions.ts";
import type { CaseLayers } from "./case-layers.ts";
import { button, choiceOfButtons, line, press, row } from "./fields.ts";
import { PlacesTable } from "./places-table.ts";

interface MapsActions extends Actions {
  /** The chart of the marked point stands here; null: where it usually does. */
  chart(place: HTMLElement | null): void;
  /** A place becomes a finding, is dismissed, or neither. */
  judge(place: Candidate, judgement: "kept" | "dismissed" | null): void;
}

export class MapsSection {
  readonly element: HTMLElement;
  readonly #shown: ReadyCase;
  readonly #layers: CaseLayers;
  readonly #actions: MapsActions;
  readonly #names: HTMLElement;
  readonly #about = h("p", { class: "quiet", hidden: true });
  readonly #status = h("p", { class: "quiet maps-status", id: "maps-status", role: "status", hidden: true });
  /** Where the controls of an overlay stand. */
  readonly slot = h("div", {});
  readonly #ask: HTMLButtonElement;
  readonly #warning = h(
    "details",
    { class: "candidates-warning", hidden: true },
    h("summary", {}, t("candidates.normal")),
    h("p", { class: "quiet" }, t("candidates.warning")),
  );
  /** That nothing stands out, or that the regions are in doubt. */
  readonly #nothing = h("p", { class: "nothing", id: "nothing-stands-out", role: "status", hidden: true });
  readonly #doubt = h("p", { class: "quiet regions-doubt", hidden: true });
  readonly #places: PlacesTable;
  /** How much of the junction the cuts meet slantwise, by depth. */
  readonly #slant = h("div", { class: "group-part slant", hidden: true });
  #bands: readonly JunctionBand[] = [];
  /** Whether there are maps, or will be. */
  #isKnown = true;
  #candidates: readonly Candidate[] = [];
  #state: ViewState | null = null;

  constructor(shown: ReadyCase, layers: CaseLayers, actions: MapsActions) {
    this.#shown = shown;
    this.#layers = layers;
    this.#actions = actions;
    this.#names = choiceOfButtons(
      t("map.label"),
      ["none", ...MAP_NAMES],
      (name) => t(`map.${name}`),
      (name) => this.#choose(name),
    );
    this.#places = new PlacesTable(shown, {
      go: ({ position_in_patient, depth_mm }, layout) => {
        const wanted = layout ?? this.#state?.layout ?? "single";
        this.#actions.change(broughtTo(position_in_patient, depth_mm, wanted, this.#shown), true);
      },
      sharpness: () => this.#layers.voxels("sharpness"),
      judge: (place, judgement) => this.#actions.judge(place, judgement),
    });
    this.#ask = button(t("candidates.ask"), () => void this.#askForCandidates(), { "aria-describedby": "maps-status" });
    this.element = h(
      "div",
      { class: "group-body" },
      this.#names,
      this.#about,
      this.slot,
      row(this.#ask),
      this.#status,
      this.#nothing,
      this.#doubt,
      this.#warning,
      this.#places.element,
      this.#slant,
    );
  }

  show(state: ViewState): void {
    this.#state = state;
    const { overlay } = state;
    press(this.#names, overlay?.name ?? "none");
    this.#about.hidden = !overlay || !isMap(overlay.name);
    this.#mark();
    this.#markBand(state.depth_mm);
    if (overlay && isMap(overlay.name)) setText(this.#about, t(`map.${overlay.name}.about`));
  }

  /** Shows the state of the maps, which is the same of all. */
  tell({ state, reason = "", reason_code }: Pick<Layer, "state" | "reason" | "reason_code">): void {
    const words =
      state === "undefined"
        ? t("maps.undefined", { reason: reasonIn(reason, reason_code) })
        : t(state === "off" ? "maps.off" : "maps.making");
    this.#isKnown = state !== "undefined" && state !== "off";
    this.#ask.disabled = !this.#isKnown;
    this.#say(state === "ready" ? "" : words);
  }

  /** Plots the share of the junction that the cuts meet slantwise, of the depths at which there is any. */
  plot({ junction_by_depth, junction_poorly_met }: LayerList): void {
    this.#bands = junction_by_depth.filter(({ places }) => places > 0);
    this.#slant.hidden = this.#bands.length === 0;
    const bars = this.#bands.map(({ from_mm, to_mm, slanted_share }) => {
      const depths = to_mm === undefined ? `> ${number(from_mm)} mm` : `${number(from_mm)} – ${number(to_mm)} mm`;
      const share = `${number(100 * slanted_share)} %`;
      const bar = h("meter", { value: slanted_share, "aria-label": `${depths}: ${share}` });
      return line(depths, bar, h("span", { class: "value quiet", "aria-hidden": "true" }, share));
    });
    const total =
      junction_poorly_met === undefined ? "" : t("map.slant.total", { share: number(100 * junction_poorly_met) });
    this.#slant.replaceChildren(quiet(t("map.slant")), ...bars, h("p", { class: "poorly-met" }, total));
    if (this.#state) this.#markBand(this.#state.depth_mm);
  }

  /** Marks the bar of the depth that is shown. */
  #markBand(depth_mm: number): void {
    for (const [at, { from_mm, to_mm }] of this.#bands.entries())
      this.#slant.children[at + 1]?.setAttribute(
        "aria-current",
        String(from_mm <= depth_mm && depth_mm < (to_mm ?? Infinity)),
      );
  }

  #say(words: string): void {
    tell(this.#status, words);
  }

  /** Shows a map, or none; one that is shown already stays. */
  #choose(name: MapName | "none"): void {
    if (name === "none") this.#actions.change({ overlay: null }, true);
    else if (this.#state?.overlay?.name !== name) this.#actions.command({ kind: "map", name });
  }

  // -- Places to look at

  async #askForCandidates(): Promise<void> {
    this.#ask.disabled = true;
    this.#say(t("maps.asking"));
    try {
      await this.#layers.ask();
      if (this.#layers.ready("blur")) this.#put(await this.#layers.candidates());
    } catch (problem) {
      this.#say(problemWords(problem));
    }
    this.#ask.disabled = !this.#isKnown;
  }

  #put({ candidates, nothing_stands_out, regions }: CandidateList): void {
    this.#say(candidates.length === 0 ? t("candidates.none") : "");
    tell(this.#nothing, nothing_stands_out ? t("candidates.nothing") : "");
    const [reason = "", code = ""] = [regions.reasons[0], regions.reason_codes[0]];
    tell(this.#doubt, regions.state === "review" ? t("regions.doubt", { reason: reasonIn(reason, code) }) : "");
    this.#candidates = candidates;
    this.#warning.hidden = candidates.length === 0;
    this.#places.fill(candidates);
    this.#mark();
  }

  /** Opens the place that is gone to. */
  #mark(): void {
    const place = this.#markedPlace(this.#state) ?? null;
    this.#places.open(place);
    this.#actions.chart(place && this.#places.chart);
  }

  /** Shows which places are findings, or dismissed. */
  judged(findings: readonly Finding[]): void {
    this.#places.judged(findings);
  }

  /**
   * Goes to the next place or to the one before; the first time, to the first. Resolves to what there is to say where
   * there is none.
   */
  async step(steps: number): Promise<string> {
    if (!this.#places.isFilled) await this.#askForCandidates();
    const isGone = this.#places.step(steps);
    return isGone ? "" : (this.#nothing.textContent ?? "");
  }

  /** The listed place at the marked point. */
  #markedPlace(state: ViewState | null): Candidate | undefined {
    const text = (position: readonly number[]): string => position.map((part) => part.toFixed(1)).join();
    const marked = state?.crosshair_mm;
    return marked ? this.#candidates.find((one) => text(one.position_in_patient) === text(marked)) : undefined;
  }

  /** A state with the outline of the marked place, if that is too weak for the map's colours. */
  outlined(state: ViewState): ViewState {
    if (state.overlay?.name !== "blur") return state;
    const place = this.#markedPlace(state);
    const isColoured = place && place.score > Number(state.overlay.threshold);
    return place && !isColoured ? { ...state, place_mm: place.size_mm } : state;
  }
}
