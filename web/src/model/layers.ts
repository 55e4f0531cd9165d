// The layers of a case as the server lists them: its maps, and the volumes that were added.

import type { Intensity, ProblemBody } from "./case.ts";
import { type GreyLayer, type LayerOverlay, type MapStyle, OVERLAY_COLORMAPS, isLayerId } from "./maps.ts";
import { windowBetween } from "./state.ts";
import type { Affine } from "./space.ts";

export const LAYER_KINDS = ["mr", "ct", "pet", "map", "labels"] as const;
export type LayerKind = (typeof LAYER_KINDS)[number];
export const CONTRASTS = ["t1", "t2", "flair", "other"] as const;
export type Contrast = (typeof CONTRASTS)[number];
export const TRANSFORMS = ["auto", "rigid", "none"] as const;

/** A layer; from `window` on, what is known once it is ready. */
export interface Layer {
  readonly id: string;
  readonly name: string;
  readonly kind: LayerKind;
  readonly unit: string;
  /** The layer that the map `flair` belongs to. */
  readonly of_layer?: string;
  /** Of an MR that was added, if it is known. */
  readonly contrast?: Contrast;
  readonly state: "ready" | "making" | "undefined" | "off" | "queued" | "preparing" | "failed";
  /** Why it is undefined or off; of a layer that is ready, why its place must be checked. */
  readonly reason?: string;
  /** What the reason is called, for the page's words in other languages; absent from servers without such names. */
  readonly reason_code?: string;
  readonly error?: ProblemBody;
  readonly window?: readonly [number, number];
  readonly colormap?: MapStyle["colormap"];
  readonly threshold?: number;
  readonly opacity?: number;
  readonly case_from_layer?: Affine;
  readonly origin?: "header" | "registered" | "by-hand";
  readonly verdict?: "registered" | "unchanged" | "unchecked";
  readonly quality?: "ok" | "review";
  readonly range?: readonly [number, number];
  readonly labels?: readonly { readonly value: number; readonly name: string }[];
}

/** How slantwise the cuts between two depths meet the junction. */
export interface JunctionBand {
  readonly from_mm: number;
  /** Absent for the deepest. */
  readonly to_mm?: number;
  readonly places: number;
  readonly slanted_share: number;
}

export interface LayerList {
  readonly layers: readonly Layer[];
  readonly junction_by_depth: readonly JunctionBand[];
  /** The share that is met slantwise or lies deeper than 30 mm, if the cerebrum is known. */
  readonly junction_poorly_met?: number;
}

export const isAdded = ({ id }: Layer): boolean => isLayerId(id);
export const isBusy = ({ state }: Layer): boolean => state === "queued" || state === "preparing" || state === "making";
export const isReady = ({ state }: Layer): boolean => state === "ready";

/** A layer that is ready as a texture; null of labels, which have colours alone. */
export function greyOf({ id, kind, window, range }: Layer): (GreyLayer & { readonly intensity: Intensity }) | null {
  if (!window || kind === "labels") return null;
  const [min, max] = range ?? window;
  return { id, intensity: { min, max, window: windowBetween(...window) } };
}

/** A layer that is ready over the picture, as the server shows it first. */
export const overlayOf = ({ id, threshold, opacity }: Layer): LayerOverlay => ({
  name: id,
  threshold: threshold ?? null,
  opacity: opacity ?? 1,
});

/** How the server shows a layer that is ready. */
export const styleOfLayer = ({ unit, window, colormap, threshold }: Layer): MapStyle => ({
  unit,
  window: window ?? [0, 1],
  colormap: colormap === "labels" ? colormap : (OVERLAY_COLORMAPS.find((one) => one === colormap) ?? "hot"),
  threshold: threshold ?? null,
});

/** The next of some layers after the one that is shown, then none: what a key goes through. */
export function nextOf<Id extends string>(ids: readonly Id[], shown: Id | null): Id | null {
  return ids[shown === null ? 0 : ids.indexOf(shown) + 1] ?? null;
}
