// The section of the panel for the maps: which of them lies over the picture, how, and a list of places to look at.

import { h, quiet, setText, tell } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { reasonIn } from "../base/case-words.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import type { Finding } from "../model/findings.ts";
import type { JunctionBand, Layer, LayerList } from "../model/layers.ts";
import {
  type Candidate,
  type CandidateList,
  LISTING_MAPS,
  type ListingMap,
  MAP_NAMES,
  type MapName,
  isMap,
} from "../model/maps.ts";
import type { ViewState } from "../model/state.ts";
import type { Actions } from "./actions.ts";
import type { CaseLayers } from "./case-layers.ts";
import { choiceOfButtons, line, press } from "./fields.ts";
import { PlacesList } from "./places-list.ts";

interface MapsActions extends Actions {
  /** The chart of the marked point stands here; null: where it usually does. */
  chart(place: HTMLElement | null): void;
  /** A place becomes a finding, is dismissed, or neither. */
  judge(place: Candidate, judgement: "kept" | "dismissed" | null, map: ListingMap): void;
}

export class MapsSection {
  readonly element: HTMLElement;
  readonly #layers: CaseLayers;
  readonly #actions: MapsActions;
  readonly #names: HTMLElement;
  readonly #about = h("p", { class: "quiet", hidden: true });
  readonly #status = h("p", { class: "quiet maps-status", id: "maps-status", role: "status", hidden: true });
  /** Where the controls of an overlay stand. */
  readonly slot = h("div", {});
  /** The places of blur, then those of thick cortex, then those of the FLAIR: never mixed. */
  readonly #lists: readonly PlacesList[];
  /** Those of the FLAIR among them. */
  readonly #flairs: PlacesList;
  /** Where keys step: the list that was asked for, unfolded or gone through last. */
  #stepped: PlacesList;
  /** How much of the junction the cuts meet slantwise, by depth. */
  readonly #slant = h("div", { class: "group-part slant", hidden: true });
  #bands: readonly JunctionBand[] = [];
  /** The layer whose map is listed. */
  #flairOf: string | undefined;
  #findings: readonly Finding[] = [];
  #state: ViewState | null = null;

  constructor(shown: ReadyCase, layers: CaseLayers, actions: MapsActions) {
    this.#layers = layers;
    this.#actions = actions;
    this.#names = choiceOfButtons(
      t("map.label"),
      ["none", ...MAP_NAMES],
      (name) => t(`map.${name}`),
      (name) => this.#choose(name),
    );
    const list = (map: ListingMap): PlacesList => {
      const made: PlacesList = new PlacesList(map, shown, {
        go: ({ position_in_patient, depth_mm }, layout) => {
          this.#stepped = made;
          this.#actions.bring(position_in_patient, depth_mm, layout ?? undefined);
        },
        used: () => (this.#stepped = made),
        sharpness: () => this.#layers.voxels("sharpness"),
        judge: (place, judgement, of) => this.#actions.judge(place, judgement, of),
        ask: (of) => this.#askForCandidates(of),
        say: (words) => this.#say(words),
        listed: () => {
          this.#stepped = made;
          made.judged(this.#findings);
          this.#mark();
        },
      });
      return made;
    };
    const blurred = list("blur");
    this.#flairs = list("flair");
    this.#lists = LISTING_MAPS.map((map) => (map === "blur" ? blurred : map === "flair" ? this.#flairs : list(map)));
    this.#stepped = blurred;
    this.tellFlair(undefined);
    this.element = h(
      "div",
      { class: "group-body" },
      this.#names,
      this.#about,
      this.slot,
      this.#status,
      ...this.#lists.map(({ element }) => element),
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
    const isKnown = state !== "undefined" && state !== "off";
    for (const list of this.#lists) list.isKnown = isKnown;
    this.#say(state === "ready" ? "" : words);
    if (state === "ready") for (const list of this.#lists) list.resume();
  }

  /** Shows the state of the map of the newest FLAIR, which is offered only if there is such a layer. */
  tellFlair(map: Layer | undefined): void {
    for (const one of this.#names.querySelectorAll<HTMLButtonElement>("button[value=flair]")) one.hidden = !map;
    this.#flairs.element.hidden = !map;
    if (map?.of_layer !== this.#flairOf) this.#flairs.clear();
    this.#flairOf = map?.of_layer;
    const isUndefined = map?.state === "undefined";
    this.#flairs.tell(isUndefined ? t("flair.undefined", { reason: reasonIn(map.reason ?? "", map.reason_code) }) : "");
    this.#flairs.isKnown = !isUndefined && map?.state !== "off";
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

  async #askForCandidates(map: ListingMap): Promise<CandidateList | null> {
    this.#say(t("maps.asking"));
    try {
      await this.#layers.ask();
      return this.#layers.ready(map) ? await this.#layers.candidates(map) : null;
    } catch (problem) {
      this.#say(problemWords(problem));
      return null;
    }
  }

  /** Opens the place that is gone to. */
  #mark(): void {
    const opened = this.#lists.filter((list) => list.mark(this.#state));
    this.#actions.chart(opened[0]?.chart ?? null);
  }

  /** Shows which places are findings, or dismissed. */
  judged(findings: readonly Finding[]): void {
    this.#findings = findings;
    for (const list of this.#lists) list.judged(findings);
  }

  /**
   * Goes to the next place or to the one before; the first time, to the first. Resolves to what there is to say where
   * there is none.
   */
  async step(steps: number): Promise<string> {
    if (!this.#stepped.isFilled) await this.#stepped.ask();
    const isGone = this.#stepped.step(steps);
    return isGone ? "" : this.#stepped.words;
  }

  /** A state with the outline of the marked place, if that is too weak for the map's colours. */
  outlined(state: ViewState): ViewState {
    const at = state.overlay ? LISTING_MAPS.findIndex((map) => map === state.overlay?.name) : -1;
    if (!state.overlay || at < 0) return state;
    const place = this.#lists[at]?.markedPlace(state);
    const isColoured = place && place.score > Number(state.overlay.threshold);
    return place && !isColoured ? { ...state, place_mm: place.size_mm } : state;
  }
}
