// The marked point: what is known of it here, and what the server measures at it.

import { type ReadonlySignal, computed, effect, signal, untracked } from "@preact/signals";

import { depthAtWords, positionWords, valueWords } from "../base/readout.ts";
import type { Picked } from "../model/points.ts";
import type { Measured, Profile } from "../model/profile.ts";
import type { Vec3 } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import { DEEP_MM } from "../model/commands.ts";
import { isHalf } from "../model/surfaces.ts";
import { measuredAt } from "./measured.ts";
import type { ShownLayers } from "./shown-layers.ts";
import type { Surface } from "./surface.ts";
import type { View } from "./view.ts";

/** As far as rounding can move a point. */
const BORDER_MM = 0.05;

export interface PointWords {
  readonly position: string;
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
  /** Why no point was marked, until another one is or another depth is shown. */
  readonly missed = signal("");
  /** Whether the point is so deep that the cut through the whole brain meets it slantwise; of a half, the inner side has it. */
  readonly isDeep: ReadonlySignal<boolean>;
  /** What was seen where a hand marked it, and on which surface. */
  picked: (Picked & Pick<ViewState, "surface">) | null = null;
  readonly #surface: () => Surface | null;
  readonly #layers: ShownLayers;
  #asked = new AbortController();
  readonly #ends: readonly (() => void)[];

  /** What follows `surface` hears when more is known. */
  constructor(view: View, surface: () => Surface | null, layers: ShownLayers) {
    this.#surface = surface;
    this.#layers = layers;
    this.position = computed(() => view.state.value.crosshair_mm);
    this.isDeep = computed(() => {
      const position = this.position.value;
      const isWhole = !isHalf(view.state.value.surface);
      return position !== null && isWhole && (surface()?.wholeDepth(position) ?? 0) > DEEP_MM;
    });
    const shown = computed(() => view.state.value.surface);
    // What a hand saw holds for its mark alone, and on its surface.
    const pickedAt = (position: Vec3): Picked | null => {
      const { picked } = this;
      return picked?.surface === shown.value && String(picked.position_in_patient) === String(position) ? picked : null;
    };
    // The same words are not told with each frame of a drag.
    const values = computed(() => {
      const position = this.position.value;
      return position ? this.valuesAt(position, pickedAt(position)?.intensity) : "";
    });
    this.words = computed(() => {
      const position = this.position.value;
      if (!position) return null;
      const known: Partial<Picked> = pickedAt(position) ?? surface()?.probe(position) ?? {};
      return { position: positionWords(position), depth: depthAtWords(known.depth_mm), intensity: values.value };
    });
    this.profile = computed(() => (this.position.value && surface()?.profile(this.position.value)) ?? null);
    // Asked about once, as soon as its depth is known.
    const asked = computed(() => (this.profile.value ? this.position.value : null));
    this.#ends = [
      effect(() => {
        const position = asked.value;
        // Depths are those below the surface that is shown.
        void shown.value;
        untracked(() => this.#measure(view, position));
      }),
      effect(() => {
        void [this.position.value, view.depth_mm.value];
        this.missed.value = "";
      }),
    ];
  }

  dispose(): void {
    this.#asked.abort();
    for (const end of this.#ends) end();
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
