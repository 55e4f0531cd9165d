// The places to look at that the maps list: asked for, gone through, and which of them a reader has seen.

import { parsed } from "../model/text.ts";
import { type ReadonlySignal, type Signal, computed, effect, signal, untracked } from "@preact/signals";

import { reasonIn } from "../base/case-words.ts";
import { t } from "../base/i18n.ts";
import { keep, keptText } from "../base/kept.ts";
import { problemWords } from "../base/problem-words.ts";
import { type Candidate, type CandidateList, LISTING_MAPS, type ListingMap, standsOut } from "../model/maps.ts";
import type { ViewState } from "../model/state.ts";
import type { CaseLayers } from "./case-layers.ts";
import type { View } from "./view.ts";

export const LIST_WORDS = {
  blur: { ask: "candidates.ask", nothing: "candidates.nothing", warning: "candidates.warning" },
  thickness: { ask: "thick.ask", nothing: "thick.nothing", warning: "thick.warning" },
  flair: { ask: "flair.ask", nothing: null, warning: "flair.warning" },
} as const;

/** The lists that were asked for, by case and map, as long as the page is open: another language builds the page again. */
const ASKED = new Set<string>();
/** Where the window keeps the places of a case that were looked at. */
const seenKey = (id: string): string => `isocortex-seen-${id}`;

/** The places that were looked at in this window, also before it was loaded again. */
function readSeen(id: string): ReadonlySet<string> {
  const stored = parsed(keptText("sessionStorage", seenKey(id)));
  return new Set(Array.isArray(stored) ? stored.filter((one) => typeof one === "string") : []);
}

export const nameOf = (position: readonly number[]): string => position.map((part) => part.toFixed(1)).join();

export class PlacesOfMap {
  readonly map: ListingMap;
  readonly list = signal<CandidateList | null>(null);
  readonly isAsking = signal(false);
  /** Whether it was asked for in this page. */
  isAsked = false;
  readonly isUnfolded = signal(false);
  /** The listed place at the marked point. */
  readonly open: ReadonlySignal<Candidate | null>;

  constructor(map: ListingMap, { state }: View) {
    this.map = map;
    this.open = computed(() => {
      const { crosshair_mm } = state.value;
      const name = crosshair_mm && nameOf(crosshair_mm);
      return name ? (this.candidates.find((one) => nameOf(one.position_in_patient) === name) ?? null) : null;
    });
  }

  get candidates(): readonly Candidate[] {
    return this.list.value?.candidates ?? [];
  }

  /** That nothing stands out, and what is to be known about the scores. */
  get nothingWords(): string {
    const { nothing_stands_out, caveat } = this.list.value ?? {};
    const { nothing } = LIST_WORDS[this.map];
    return [nothing_stands_out && nothing ? t(nothing) : "", caveat ? reasonIn(caveat.reason, caveat.reason_code) : ""]
      .filter((words) => words !== "")
      .join(" ");
  }
}

export class Places {
  /** The places of blur, then those of thick cortex, then those of the FLAIR: never mixed. */
  readonly lists: readonly PlacesOfMap[];
  /** What is to be said about all of them. */
  readonly said = signal("");
  readonly #id: string;
  readonly #layers: CaseLayers;
  readonly #seen: Signal<ReadonlySet<string>>;
  /** The layer whose map lists the places of the FLAIR. */
  #flairOf: string | undefined;
  readonly #ends: (() => void)[] = [];

  constructor(view: View, layers: CaseLayers) {
    this.#id = view.shown.id;
    this.#layers = layers;
    this.#seen = signal(readSeen(this.#id));
    this.lists = LISTING_MAPS.map((map) => new PlacesOfMap(map, view));
    for (const list of this.lists) {
      this.#ends.push(
        effect(() => {
          const place = list.open.value;
          if (place) untracked(() => this.#look(place));
        }),
      );
    }
    this.#ends.push(effect(() => this.#hear()));
  }

  dispose(): void {
    for (const end of this.#ends) end();
  }

  isSeen({ position_in_patient }: Candidate): boolean {
    return this.#seen.value.has(nameOf(position_in_patient));
  }

  /** The places of a map that stand out, whether or not they are listed; null until the map is ready. */
  async standingOut({ map, list }: PlacesOfMap): Promise<readonly Candidate[] | null> {
    await this.#layers.ask();
    if (!this.#layers.ready(map)) return null;
    return (list.peek() ?? (await this.#layers.candidates(map))).candidates.filter(standsOut);
  }

  async ask(list: PlacesOfMap): Promise<void> {
    ASKED.add(`${this.#id} ${list.map}`);
    list.isAsked = true;
    list.isAsking.value = true;
    this.said.value = t("maps.asking");
    try {
      await this.#layers.ask();
      if (this.#layers.ready(list.map)) {
        const places = await this.#layers.candidates(list.map);
        this.said.value = places.candidates.length === 0 ? t("candidates.none") : "";
        list.isUnfolded.value = false;
        list.list.value = places;
      }
    } catch (problem) {
      this.said.value = problemWords(problem);
    }
    list.isAsking.value = false;
  }

  /** A state with the outline of the marked place, if that is too weak for the map's colours. */
  outlined(state: ViewState): ViewState {
    const { overlay } = state;
    const place = overlay && this.lists.find(({ map }) => map === overlay.name)?.open.value;
    const isColoured = place && place.score > Number(overlay.threshold);
    return place && !isColoured ? { ...state, place_mm: place.size_mm } : state;
  }

  #look(place: Candidate): void {
    this.#seen.value = new Set(this.#seen.peek()).add(nameOf(place.position_in_patient));
    keep("sessionStorage", seenKey(this.#id), [...this.#seen.peek()]);
  }

  /** The maps have been listed: their state is the same of all, but for that of the newest FLAIR. */
  #hear(): void {
    const layers = this.#layers.list.value?.layers;
    const [first] = layers ?? [];
    if (!layers || !first) return;
    const flair = layers.find(({ id }) => id === "flair");
    untracked(() => {
      // Places of another layer.
      if (flair?.of_layer !== this.#flairOf)
        for (const one of this.lists) if (one.map === "flair") one.list.value = null;
      this.#flairOf = flair?.of_layer;
      const { id, state } = first;
      this.said.value = this.#layers.whyNone(id) || (state === "ready" ? "" : t("maps.making"));
      if (state !== "ready") return;
      for (const one of this.lists) if (!one.isAsked && ASKED.has(`${this.#id} ${one.map}`)) void this.ask(one);
    });
  }
}
