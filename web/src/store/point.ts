// The marked point: what is known of it here, and what the server measures at it.

import { type ReadonlySignal, computed, effect, signal, untracked } from "@preact/signals";

import { t } from "../base/i18n.ts";
import { depthAtWords, positionWords, valueWords, voxelAt } from "../base/readout.ts";
import { number } from "../base/i18n.ts";
import type { Picked } from "../model/points.ts";
import type { Measured, Profile } from "../model/profile.ts";
import type { Vec3 } from "../model/space.ts";
import { measuredAt } from "./measured.ts";
import type { ShownLayers } from "./shown-layers.ts";
import type { Surface } from "./surface.ts";
import type { View } from "./view.ts";

/** As far as rounding can move a point. */
const BORDER_MM = 0.05;

/** The point in words. */
export interface PointWords {
  readonly position: string;
  readonly voxel: string;
  readonly depth: string;
  readonly intensity: string;
}

export class MarkedPoint {
  readonly position: ReadonlySignal<Vec3 | null>;
  readonly words: ReadonlySignal<PointWords | null>;
  /** Intensity against depth below it; null where that is not known. */
  readonly profile: ReadonlySignal<Profile | null>;
  /** What the server has measured at it. */
  readonly measured = signal<Measured | null>(null);
  /** Why no point was marked, or what is to be known of the one that is. */
  readonly hint = signal("");
  /** What was seen where a hand marked it. */
  picked: Picked | null = null;
  readonly #surface: () => Surface | null;
  readonly #layers: ShownLayers;
  #asked = new AbortController();
  readonly #end: () => void;

  /** What follows `surface` hears when more is known. */
  constructor(view: View, surface: () => Surface | null, layers: ShownLayers) {
    this.#surface = surface;
    this.#layers = layers;
    this.position = computed(() => view.state.value.crosshair_mm);
    this.words = computed(() => {
      const position = this.position.value;
      if (!position) return null;
      const known: Partial<Picked> = this.picked ?? surface()?.probe(position) ?? {};
      const voxel = voxelAt(view.shown, position);
      return {
        position: positionWords(position),
        voxel: voxel ? voxel.map((part) => number(part)).join(", ") : t("point.outside"),
        depth: depthAtWords(known.depth_mm),
        intensity: this.valuesAt(position, known.intensity),
      };
    });
    this.profile = computed(() => (this.position.value && surface()?.profile(this.position.value)) ?? null);
    // Asked about once, as soon as its depth is known.
    const asked = computed(() => (this.profile.value ? this.position.value : null));
    this.#end = effect(() => {
      const position = asked.value;
      untracked(() => this.#measure(view, position));
    });
  }

  dispose(): void {
    this.#asked.abort();
    this.#end();
  }

  /** The intensities at a position, of all volumes that are shown, in words. */
  valuesAt(position: Vec3, grey = this.#surface()?.probe(position)?.intensity ?? null): string {
    return valueWords(grey, this.#layers.valuesAt(position));
  }

  #measure(view: View, position: Vec3 | null): void {
    this.#asked.abort();
    this.measured.value = null;
    // Outside the envelope, and on its border, nothing is measured.
    if (!position || !(Number(this.#surface()?.probe(position)?.depth_mm) > BORDER_MM)) return;
    const { signal: given } = (this.#asked = new AbortController());
    measuredAt(view.shown.id, position, this.#layers.drawn.peek().surface, given).then(
      (measured) => {
        if (!given.aborted) this.measured.value = measured;
      },
      // Without an answer the page's own curves stand alone.
      () => {},
    );
  }
}
