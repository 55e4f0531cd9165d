// The places of the list as a table: a row for each, and below the open one what is known of it.

import { h, setText } from "../base/dom.ts";
import { gyrusWords, number, t } from "../base/i18n.ts";
import { positionWords } from "../base/readout.ts";
import { mirrorPlane, reflected } from "../model/midsagittal.ts";
import type { ReadyCase } from "../model/case.ts";
import { type Candidate, type ListingMap, standsOut } from "../model/maps.ts";
import { type Finding, findingOfPlace } from "../model/findings.ts";
import type { Layout } from "../model/state.ts";
import { WHY_PARTS, type Why, whyAt } from "../model/why.ts";
import type { Block } from "../model/wire.ts";
import { button, choiceOfButtons, line, press, row } from "./fields.ts";

/** What opens beside the surface when a place is gone to. */
const BESIDE = ["closer", "slices", "mirror", "both"] as const satisfies readonly Layout[];
/** A bar of this score is as wide as its column. */
const WIDEST_SCORE: Readonly<Record<ListingMap, number>> = { blur: 4, thickness: 8, flair: 4 };
const COLUMNS = ["rank", "side", "gyrus", "depth", "score", "seen"] as const;
type Column = (typeof COLUMNS)[number];
const headOf = (column: Column): string => t(column === "gyrus" ? "gyrus.about" : `places.${column}`);

/** What a reader decides about a place. */
const JUDGEMENTS = ["kept", "dismissed"] as const;
type Judgement = (typeof JUDGEMENTS)[number];

export interface PlacesListener {
  /** A place is gone to, in a layout; null: in the one that is shown. */
  go(place: Candidate, layout: Layout | null): void;
  /** The list is in use now: keys step through it. */
  used(): void;
  sharpness(): Promise<Block>;
  /** A place becomes a finding, is dismissed, or neither. */
  judge(place: Candidate, judgement: Judgement | null, map: ListingMap): void;
}

/** The places that were looked at, by case, as long as the page is open. */
const SEEN = new Map<string, Set<string>>();
const nameOf = (place: Candidate): string => place.position_in_patient.map((part) => part.toFixed(1)).join();

export class PlacesTable {
  readonly element: HTMLElement;
  readonly #table: HTMLElement;
  /** Shows the places that do not stand out, or folds them again. */
  readonly #fold = button("", () => this.#turn(), { class: "fold" });
  #isUnfolded = false;
  readonly #map: ListingMap;
  readonly #shown: ReadyCase;
  readonly #listener: PlacesListener;
  readonly #body = h("tbody", { keydown: (event: KeyboardEvent) => this.#walk(event) });
  /** Where the chart of the open place stands. */
  readonly chart = h("div", { class: "place-chart" });
  #places: readonly Candidate[] = [];
  #open: Candidate | null = null;
  /** The findings of the case, those taken from places among them. */
  #findings: readonly Finding[] = [];
  #judging: HTMLElement | null = null;

  constructor(map: ListingMap, label: string, shown: ReadyCase, listener: PlacesListener) {
    this.#map = map;
    this.#shown = shown;
    this.#listener = listener;
    const heads = COLUMNS.map((name) => h("th", { scope: "col", class: name }, headOf(name)));
    this.#table = h(
      "table",
      { class: "candidates", "aria-label": label },
      h("thead", {}, h("tr", {}, ...heads)),
      this.#body,
    );
    this.element = h("div", { class: "places", hidden: true }, this.#table, this.#fold);
  }

  get isFilled(): boolean {
    return this.#places.length > 0;
  }

  fill(places: readonly Candidate[]): void {
    this.#places = places;
    this.#open = null;
    this.element.hidden = places.length === 0;
    // Without an atlas no place has a name, and the column no place.
    this.#table.classList.toggle(
      "named",
      places.some(({ gyrus }) => gyrusWords(gyrus) !== ""),
    );
    this.#body.replaceChildren(...places.map((place, at) => this.#row(place, at)));
    this.#fold.hidden = places.every(standsOut);
    this.#unfold(false);
  }

  /** Goes to the place so many shown rows further; without an open one to the first. Whether there is one. */
  step(steps: number): boolean {
    const shown = this.#shownPlaces;
    const at = this.#open ? shown.indexOf(this.#open) + steps : 0;
    const place = shown[Math.min(Math.max(at, 0), shown.length - 1)];
    if (!place) return false;
    this.#listener.go(place, null);
    this.#rowOf(place)?.scrollIntoView({ block: "nearest" });
    return true;
  }

  get #shownPlaces(): readonly Candidate[] {
    return this.#isUnfolded ? this.#places : this.#places.filter(standsOut);
  }

  #turn(): void {
    this.#unfold(!this.#isUnfolded);
    if (this.#isUnfolded) this.#listener.used();
  }

  #unfold(isUnfolded: boolean): void {
    this.#isUnfolded = isUnfolded;
    const shown = this.#shownPlaces;
    this.#table.hidden = shown.length === 0;
    for (const [at, element] of this.#rows.entries()) element.hidden = !shown.includes(this.#places[at] as Candidate);
    const why = this.#body.querySelector<HTMLElement>(".why");
    if (why) why.hidden = this.#open !== null && !shown.includes(this.#open);
    const count = number(this.#places.filter((place) => !standsOut(place)).length);
    this.#fold.setAttribute("aria-expanded", String(isUnfolded));
    setText(this.#fold, t(isUnfolded ? "places.fold" : "places.unfold", { count }));
    this.#mark();
  }

  /** Opens the row of a place, or none. */
  open(place: Candidate | null): void {
    if (place === this.#open) return;
    this.#open = place;
    this.#body.querySelector(".why")?.remove();
    if (place) {
      // What is gone to is shown.
      if (!this.#shownPlaces.includes(place)) this.#unfold(true);
      const seen = SEEN.get(this.#shown.id) ?? new Set();
      SEEN.set(this.#shown.id, seen.add(nameOf(place)));
      this.#rowOf(place)?.after(this.#details(place));
    }
    this.#mark();
  }

  #rowOf(place: Candidate): HTMLElement | undefined {
    return this.#rows[this.#places.indexOf(place)];
  }

  get #rows(): readonly HTMLElement[] {
    return [...this.#body.querySelectorAll<HTMLElement>("tr.place")];
  }

  #row(place: Candidate, at: number): HTMLElement {
    const { side, depth_mm, score, unusual } = place;
    const gyrus = gyrusWords(place.gyrus);
    const where = [t(`side.${side}`), gyrus].filter(Boolean).join(" ");
    const depth = depth_mm === null ? "–" : number(depth_mm, 1);
    const words = t("candidates.place", { rank: number(at + 1), side: where, depth });
    const go = (): void => this.#listener.go(place, null);
    const bar = h("span", { class: "score-bar", "aria-hidden": "true" });
    bar.style.width = `${100 * Math.min(score / WIDEST_SCORE[this.#map], 1)}%`;
    return h(
      "tr",
      { class: "place", click: go },
      // The row's own click follows.
      h("td", {}, h("button", { class: "candidate", "aria-label": words, "aria-keyshortcuts": ", ." }, number(at + 1))),
      h("td", {}, t(`side.${side}`)),
      h("td", { class: "gyrus", title: gyrus }, gyrus || "–"),
      h("td", {}, depth_mm === null ? depth : `${depth} mm`),
      h("td", { class: "score" }, bar, h("span", {}, t(`unusual.${unusual ?? "no"}`, { score: number(score, 1) }))),
      h("td", {}, h("span", { class: "dot", role: "img" })),
    );
  }

  #mark(): void {
    const seen = SEEN.get(this.#shown.id);
    if (this.#open && this.#judging) press(this.#judging, this.#judgementOf(this.#open));
    for (const [at, element] of this.#rows.entries()) {
      const place = this.#places[at];
      if (!place) continue;
      element.setAttribute("aria-current", String(place === this.#open));
      const judgement = this.#judgementOf(place);
      const looked = seen?.has(nameOf(place)) ? "looked-at" : "not-yet";
      const key = `places.${judgement ?? looked}` as const;
      element.dataset.judgement = judgement ?? "";
      const dot = element.querySelector(".dot");
      dot?.setAttribute("aria-label", t(key));
      dot?.setAttribute("title", t(key));
      dot?.classList.toggle("filled", seen?.has(nameOf(place)));
      // The table is one stop of the tabulator.
      const button = element.querySelector("button");
      if (button) button.tabIndex = place === (this.#open ?? this.#shownPlaces[0]) ? 0 : -1;
    }
  }

  #judgementOf(place: Candidate): Judgement | null {
    const finding = findingOfPlace(this.#findings, place.position_in_patient);
    return finding ? (finding.is_dismissed ? "dismissed" : "kept") : null;
  }

  /** Shows which places are findings, or dismissed. */
  judged(findings: readonly Finding[]): void {
    this.#findings = findings;
    this.#mark();
  }

  #details(place: Candidate): HTMLElement {
    const { position_in_patient, score, size_mm } = place;
    const facts = t("candidates.facts", { score: number(score, 1), size: number(size_mm, 1) });
    const bars = h("div", { class: "why-bars" });
    this.#judging = choiceOfButtons(
      t("places.decision"),
      JUDGEMENTS,
      (one) => t(one === "kept" ? "places.keep" : "places.dismiss"),
      (one) => this.#listener.judge(place, this.#judgementOf(place) === one ? null : one, this.#map),
    );
    // The sharpness of the boundary says nothing about the other maps.
    if (this.#map === "blur") void this.#explain(place, bars);
    const goes = BESIDE.map((layout) =>
      button(t(layout === "closer" ? "closer.look" : `layout.${layout}`), () => this.#listener.go(place, layout)),
    );
    return h(
      "tr",
      { class: "why" },
      h(
        "td",
        { colspan: COLUMNS.length },
        h("p", { class: "quiet" }, `${facts} · ${positionWords(position_in_patient)}`),
        h("p", { class: "quiet" }, t("candidates.score-about")),
        this.#judging,
        row(...goes),
        bars,
        this.chart,
      ),
    );
  }

  /** Shows how sharp the junction is, once the map is here. */
  async #explain({ position_in_patient }: Candidate, bars: HTMLElement): Promise<void> {
    const sharpness = await this.#listener.sharpness().catch(() => null);
    if (!sharpness || !this.element.contains(bars)) return;
    const opposite = reflected(position_in_patient, mirrorPlane(this.#shown));
    bars.replaceChildren(
      h("p", { class: "quiet" }, t("why.title")),
      ...barsOf(whyAt(sharpness, position_in_patient, opposite)),
    );
  }

  /** Arrows go from row to row. */
  #walk(event: KeyboardEvent): void {
    const steps = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    const rows = this.#rows.filter((one) => !one.hidden);
    const at = rows.findIndex((one) => one.contains(document.activeElement));
    if (steps === undefined || at < 0 || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    rows[Math.min(Math.max(at + steps, 0), rows.length - 1)]?.querySelector("button")?.focus();
  }
}

/** A bar for each of the sharpnesses, of one scale. */
function barsOf(why: Why): readonly HTMLElement[] {
  const most = Math.max(...Object.values(why).filter(Number.isFinite), 1e-9);
  return WHY_PARTS.map((part) => {
    const value = why[part];
    const words = Number.isFinite(value) ? `${number(value, 2)} /mm` : "–";
    const label = t(`why.${part}`);
    const bar = h("meter", { value: Number.isFinite(value) ? value / most : 0, "aria-label": `${label}: ${words}` });
    return line(label, bar, h("span", { class: "value quiet", "aria-hidden": "true" }, words));
  });
}
