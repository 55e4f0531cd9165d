// What of a head a reader has looked at, and for how long: pure.

import { NAMED_VIEWS, VIEW_NAMES, type ViewName, towardsViewer } from "./camera.ts";
import type { Side } from "./midsagittal.ts";
import { clamp, dot } from "./space.ts";
import { isHalf } from "./surfaces.ts";
import { type ViewState, hasSlices, isMirrored } from "./state.ts";

/** The depths at which the bands begin, in mm; the last one has no end. */
export const BANDS_MM = [0, 6, 10, 15, 20] as const;
type Band = (typeof BANDS_MM)[number];

/** A look that lasts longer without any change counts as one of so long: the reader may have left, in ms. */
const LONGEST_MS = 60_000;
/** What was passed by more quickly was not looked at, in ms. */
const LEAST_MS = 1000;

export const bandOf = (depth_mm: number): Band => BANDS_MM.findLast((from_mm) => depth_mm >= from_mm) ?? 0;

/** The view that a state shows the most of. */
function nearestView({ orientation }: Pick<ViewState, "orientation">): ViewName {
  const towards = towardsViewer(orientation);
  const turned = (name: ViewName): number => dot(towards, towardsViewer(NAMED_VIEWS[name]));
  return VIEW_NAMES.reduce((best, name) => (turned(name) > turned(best) + 1e-6 ? name : best));
}

const OTHER: Readonly<Partial<Record<ViewName, ViewName>>> = { left: "right", right: "left" };

/** What can be looked at: the surface from each side, the slices, and the close-up of a place. */
export const LOOKS = [...VIEW_NAMES, "slices", "closer"] as const;
export type Look = (typeof LOOKS)[number];

export const LOBES = ["frontal", "parietal", "temporal", "occipital", "insula", "cingulate"] as const;
export type Lobe = (typeof LOBES)[number];
/** Where a marked place is. */
export type LobeSide = `${Lobe} ${Side}`;

/** What is on the screen: beside the mirrored half, also the same view of the other side. */
export function looksOf(state: ViewState): readonly Look[] {
  // The close-up shows slices alone.
  if (state.layout === "closer") return ["closer"];
  const view = nearestView(state);
  const other = isMirrored(state) ? OTHER[view] : undefined;
  // One half is all of the head from its outer side alone; its inner side is no look at the other half.
  const isWhole = !isHalf(state.surface) || view === state.surface;
  const views = isWhole ? [view, ...(other ? [other] : [])] : [];
  return [...views, ...(hasSlices(state) ? (["slices"] as const) : [])];
}

/** How long each view, the slices and the close-up were looked at in each band of depths, and marked places of each lobe. */
export class Checklist {
  readonly #ms = new Map<string, number>();
  #shown: { readonly keys: readonly string[]; readonly since: number } | null = null;

  /** This is on the screen from now on, with a mark in a lobe, if its lobe is known, as a step of a protocol; null: nothing is. */
  show(state: ViewState | null, now: number, lobe: LobeSide | null = null, step: string | null = null): void {
    const { keys = [], since = now } = this.#shown ?? {};
    const ms = clamp(now - since, 0, LONGEST_MS);
    for (const key of keys) this.#ms.set(key, (this.#ms.get(key) ?? 0) + ms);
    const looks = state && [...looksOf(state), ...(lobe && state.crosshair_mm ? [lobe] : [])];
    const steps = step === null ? [] : [`step ${step}`];
    this.#shown = looks && {
      keys: [...looks.map((look) => `${look} ${bandOf(state.depth_mm)}`), ...steps],
      since: now,
    };
  }

  /** For how long it was looked at, in s; 0 if it was only passed by. */
  seconds(look: Look | LobeSide, band: Band): number {
    const ms = this.#ms.get(`${look} ${band}`) ?? 0;
    return ms < LEAST_MS ? 0 : Math.round(ms / 1000);
  }

  hasStep(step: string): boolean {
    return (this.#ms.get(`step ${step}`) ?? 0) >= LEAST_MS;
  }

  clear(): void {
    this.#ms.clear();
  }
}
