// The places that one of the maps lists: a button that asks for them, what there is to say about them, and their table.

import { h, tell } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { reasonIn } from "../base/case-words.ts";
import type { ReadyCase } from "../model/case.ts";
import type { Finding } from "../model/findings.ts";
import type { Candidate, CandidateList, ListingMap } from "../model/maps.ts";
import type { ViewState } from "../model/state.ts";
import { button, row } from "./fields.ts";
import { PlacesTable, type PlacesListener } from "./places-table.ts";

/** The words of each list. */
const WORDS = {
  blur: { ask: "candidates.ask", nothing: "candidates.nothing", warning: "candidates.warning" },
  thickness: { ask: "thick.ask", nothing: "thick.nothing", warning: "thick.warning" },
  flair: { ask: "flair.ask", nothing: null, warning: "flair.warning" },
} as const;

/** The lists that were asked for, by case and map, as long as the page is open: another language builds the page again. */
const ASKED = new Set<string>();

export interface ListListener extends PlacesListener {
  /** Asks the server; resolves to nothing if it cannot be said. */
  ask(map: ListingMap): Promise<CandidateList | null>;
  say(words: string): void;
  /** The places were listed. */
  listed(): void;
}

export class PlacesList {
  readonly element = h("div", { class: "group-part" });
  readonly #map: ListingMap;
  readonly #key: string;
  readonly #listener: ListListener;
  readonly #ask: HTMLButtonElement;
  /** Why this list alone has no map. */
  readonly #why = h("p", { class: "quiet", role: "status", hidden: true });
  /** That nothing stands out, and what is to be known about the scores. */
  readonly #nothing: HTMLElement;
  readonly #doubt = h("p", { class: "quiet regions-doubt", hidden: true });
  readonly #warning: HTMLElement;
  readonly #places: PlacesTable;
  #candidates: readonly Candidate[] = [];
  #isKnown = true;
  #isAsked = false;

  constructor(map: ListingMap, shown: ReadyCase, listener: ListListener) {
    this.#map = map;
    this.#key = `${shown.id} ${map}`;
    this.#listener = listener;
    const words = WORDS[map];
    this.#ask = button(t(words.ask), () => void this.ask(), { "aria-describedby": "maps-status" });
    this.#nothing = h("p", { class: "nothing", role: "status", hidden: true });
    this.#warning = h(
      "details",
      { class: "candidates-warning", hidden: true },
      h("summary", {}, t("candidates.normal")),
      h("p", { class: "quiet" }, t(words.warning)),
    );
    this.#places = new PlacesTable(map, t(words.ask), shown, listener);
    this.element.append(row(this.#ask), this.#why);
  }

  /** Says why this list alone has no map, or that it has one. */
  tell(words: string): void {
    tell(this.#why, words);
  }

  /** Takes the places away: they are those of another layer. */
  clear(): void {
    this.#candidates = [];
    this.#places.fill([]);
    this.#warning.hidden = true;
    tell(this.#nothing, "");
    tell(this.#doubt, "");
  }

  /** Whether there are maps, or will be. */
  set isKnown(isKnown: boolean) {
    this.#isKnown = isKnown;
    this.#ask.disabled = !isKnown;
  }

  get isFilled(): boolean {
    return this.#places.isFilled;
  }

  /** What there is to say if nothing stands out. */
  get words(): string {
    return this.#nothing.textContent ?? "";
  }

  get chart(): HTMLElement {
    return this.#places.chart;
  }

  /** Asks again, once, for the list that was there before the page was built again. */
  resume(): void {
    if (this.#isAsked || !ASKED.has(this.#key)) return;
    void this.ask();
  }

  async ask(): Promise<void> {
    this.#isAsked = true;
    ASKED.add(this.#key);
    this.#ask.disabled = true;
    const list = await this.#listener.ask(this.#map);
    if (list) this.#put(list);
    this.#ask.disabled = !this.#isKnown;
  }

  #put({ candidates, nothing_stands_out, caveat, regions }: CandidateList): void {
    // A list that nobody asked for takes no place.
    this.element.append(this.#nothing, this.#doubt, this.#warning, this.#places.element);
    this.#listener.say(candidates.length === 0 ? t("candidates.none") : "");
    const { nothing } = WORDS[this.#map];
    const said = [
      nothing_stands_out && nothing ? t(nothing) : "",
      caveat ? reasonIn(caveat.reason, caveat.reason_code) : "",
    ];
    tell(this.#nothing, said.filter((words) => words !== "").join(" "));
    const [reason = "", code = ""] = [regions.reasons[0], regions.reason_codes[0]];
    tell(this.#doubt, regions.state === "review" ? t("regions.doubt", { reason: reasonIn(reason, code) }) : "");
    this.#candidates = candidates;
    this.#warning.hidden = candidates.length === 0;
    this.#places.fill(candidates);
    this.#listener.listed();
  }

  /** Opens the place that is gone to; null if it is none of these. */
  mark(state: ViewState | null): Candidate | null {
    const place = this.markedPlace(state) ?? null;
    this.#places.open(place);
    return place;
  }

  /** Shows which places are findings, or dismissed. */
  judged(findings: readonly Finding[]): void {
    this.#places.judged(findings);
  }

  step(steps: number): boolean {
    return this.#places.step(steps);
  }

  /** The listed place at the marked point. */
  markedPlace(state: ViewState | null): Candidate | undefined {
    const text = (position: readonly number[]): string => position.map((part) => part.toFixed(1)).join();
    const marked = state?.crosshair_mm;
    return marked ? this.#candidates.find((one) => text(one.position_in_patient) === text(marked)) : undefined;
  }
}
