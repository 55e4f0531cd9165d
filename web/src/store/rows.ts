// The one list of a reading: places of the maps that were asked for, findings, and places that have become findings.

import { clamp } from "../model/space.ts";
import { type ReadonlySignal, computed, effect, signal } from "@preact/signals";

import { t } from "../base/i18n.ts";
import { type Finding, findingOfPlace } from "../model/findings.ts";
import { type Candidate, standsOut } from "../model/maps.ts";
import type { Findings } from "./findings.ts";
import { type Places, type PlacesOfMap, nameOf } from "./places.ts";

export interface Row {
  /** The same before and after a reader has decided about it. */
  readonly key: string;
  readonly list: PlacesOfMap | null;
  readonly place: Candidate | null;
  readonly finding: Finding | null;
}

export class Rows {
  /** Findings of no place first, then the places in the order of their maps, whatever was decided about them. */
  readonly all: ReadonlySignal<readonly Row[]>;
  /** Places that neither stand out nor were decided about are folded away until they are wanted. */
  readonly inSight = computed(() =>
    this.all.value.filter(
      ({ list, place, finding }) => finding || list?.isUnfolded.value || (place && standsOut(place)),
    ),
  );
  /** The row that is unfolded: what is written about, else what is at the mark. */
  readonly open: ReadonlySignal<Row | null>;
  /** The row that keys have gone to. */
  readonly reached = signal("");
  /** The row of the place at the mark; the one that was gone to, where several maps list it. */
  readonly marked: ReadonlySignal<Row | null>;
  /** The finding of each place, by the key of its row. */
  readonly #taken = new Map<string, string>();
  readonly #places: Places;
  readonly #end: () => void;

  constructor(places: Places, findings: Findings) {
    this.#places = places;
    this.all = computed(() => {
      const found = new Set<Finding>();
      const ofPlaces = places.lists.flatMap((list) => {
        const ofMap = findings.list.value.filter(({ from_map }) => from_map === list.map);
        return list.candidates.map((place): Row => {
          const key = `${list.map} ${nameOf(place.position_in_patient)}`;
          // A place that another reader keeps too stays the row of the finding that it has here.
          const known = ofMap.filter((one) => findings.sync.keyOf(one) === this.#taken.get(key));
          const finding =
            findingOfPlace(known, place.position_in_patient) ??
            findingOfPlace(ofMap, place.position_in_patient) ??
            null;
          if (finding) {
            found.add(finding);
            this.#taken.set(key, findings.sync.keyOf(finding));
          }
          return { key, list, place, finding };
        });
      });
      const others = findings.list.value.filter((one) => !found.has(one));
      return [
        ...others.map((finding) => ({ key: findings.sync.keyOf(finding), list: null, place: null, finding })),
        ...ofPlaces,
      ];
    });
    this.marked = computed(() => {
      const here = this.all.value.filter(({ list, place }) => place && list?.open.value === place);
      return here.find(({ key }) => key === this.reached.value) ?? here[0] ?? null;
    });
    this.open = computed(
      () =>
        this.all.value.find(({ finding }) => finding && findings.sync.keyOf(finding) === findings.open.value) ??
        this.marked.value,
    );
    // Where the mark comes to a place, that one is in sight, and unfolded.
    const key = computed(() => (this.marked.value?.finding ? "" : (this.marked.value?.key ?? "")));
    this.#end = effect(() => {
      if (!key.value) return;
      findings.open.value = null;
      const { list, place } = this.marked.peek() ?? {};
      if (list && place && !standsOut(place)) list.isUnfolded.value = true;
    });
  }

  dispose(): void {
    this.#end();
  }

  /** The row so many further; the first time, the first one. Where there is none, places are asked for, or it is said why there are none. */
  async next(steps: number): Promise<Row | string> {
    const [first] = this.#places.lists;
    if (this.inSight.peek().length === 0 && first) await this.#places.ask(first);
    const rows = this.inSight.peek();
    const at = rows.findIndex(({ key }) => key === this.open.peek()?.key);
    const row = rows[at < 0 ? 0 : clamp(at + steps, 0, rows.length - 1)];
    this.reached.value = row?.key ?? "";
    return row ?? (first?.nothingWords || t("list.none"));
  }
}
