// The maps of the junction of grey and white matter, and how layers lie in colours over a picture: pure.

import type { Intensity } from "./case.ts";
import type { Side } from "./midsagittal.ts";
import { type Affine, type Vec3, clamp } from "./space.ts";

/** The maps, as the server names them, in the order of the page. */
export const MAP_NAMES = [
  "blur",
  "thickness",
  "flair",
  "asymmetry",
  "intensity-asymmetry",
  "sharpness",
  "junction",
] as const;
export type MapName = (typeof MAP_NAMES)[number];
/** The maps that list places, each by itself. */
export const LISTING_MAPS = ["blur", "thickness", "flair"] as const satisfies readonly MapName[];
export type ListingMap = (typeof LISTING_MAPS)[number];

/** The colour maps of overlays, as the server names them; labels have their own. */
export const OVERLAY_COLORMAPS = ["hot", "vermilion-yellow", "blue-orange", "viridis"] as const;
export type OverlayColormap = (typeof OVERLAY_COLORMAPS)[number] | "labels";

/** How the server shows a layer if nothing else is asked for; a test compares this with its list of layers. */
export interface MapStyle {
  /** Empty where the values are shares. */
  readonly unit: string;
  /** The values of the first and the last colour. */
  readonly window: readonly [number, number];
  readonly colormap: OverlayColormap;
  /** What is at most this is transparent; null: all that is defined is shown. */
  readonly threshold: number | null;
}

const ASYMMETRY: MapStyle = { unit: "z", window: [-6, 6], colormap: "blue-orange", threshold: 2.5 };
const styles: Readonly<Record<MapName, MapStyle>> = {
  blur: { unit: "z", window: [2.5, 5], colormap: "vermilion-yellow", threshold: 2.5 },
  thickness: { unit: "z", window: [2.5, 6], colormap: "vermilion-yellow", threshold: 2.5 },
  flair: { unit: "z", window: [2.5, 5], colormap: "vermilion-yellow", threshold: 2.5 },
  asymmetry: ASYMMETRY,
  "intensity-asymmetry": ASYMMETRY,
  sharpness: { unit: "1/mm", window: [0, 0.6], colormap: "viridis", threshold: null },
  junction: { unit: "", window: [0, 1], colormap: "viridis", threshold: null },
};
export const isMap = (name: string): name is MapName => Object.hasOwn(styles, name);
export const styleOfMap = (name: MapName): MapStyle => styles[name];

export interface LayerOverlay {
  /** The name of a map, or the id of a layer that was added. */
  readonly name: string;
  /** Null if all that is defined is shown. */
  readonly threshold: number | null;
  /** 0 to 1. */
  readonly opacity: number;
  /** The values of the first and the last colour, and the colours, if others are chosen. */
  readonly window?: readonly [number, number];
  readonly colormap?: OverlayColormap;
  /** Of an added layer, once the server has described it. */
  readonly about?: LayerWords & MapStyle;
  /** How it was moved by hand from where the server has it, while that is tried out. */
  readonly moved?: Affine | undefined;
}

/** What stands on a picture about a layer. */
export interface LayerWords {
  readonly title: string;
  /** Where its place comes from: `registered`, or that it is not checked. */
  readonly origin: string;
}

/** A layer as the grey texture of a picture, in the place of the intensities. */
export interface GreyLayer {
  readonly id: string;
  /** Known once the server has described it. */
  readonly intensity?: Intensity;
  readonly about?: LayerWords;
  readonly moved?: Affine | undefined;
}

export function styleOf({ name, about, window, colormap }: LayerOverlay): MapStyle {
  const usual = about ?? (isMap(name) ? styles[name] : styles.junction);
  return { ...usual, window: window ?? usual.window, colormap: colormap ?? usual.colormap };
}

/** Whether values count by their magnitude, so that both ends of the colours stand out. */
export const isDiverging = ({ colormap }: Pick<MapStyle, "colormap">): boolean => colormap === "blue-orange";

export const FIRST_OPACITY = 0.85;
/** Of maps that have a threshold. */
export const THRESHOLD_RANGE = [0, 6] as const;

/** A map as it is first shown. */
export const firstOverlay = (name: MapName): LayerOverlay => ({
  name,
  threshold: styles[name].threshold,
  opacity: FIRST_OPACITY,
});

/** The overlay alone, or none where its layer is shown already. */
export const toggled = (shown: LayerOverlay | null, wanted: LayerOverlay): LayerOverlay | null =>
  shown?.name === wanted.name ? null : wanted;

/** The part of the window over which a map fades in above its threshold. */
export const SOFT_PART = 0.1;

/** How much a value of a map hides of what is below it, 0 to 1: `render::layer`. */
export function shareOf(overlay: LayerOverlay, value: number): number {
  const { threshold, opacity } = overlay;
  const style = styleOf(overlay);
  const [low, high] = style.window;
  if (threshold === null) return opacity;
  const size = isDiverging(style) ? Math.abs(value) : value;
  const rise = clamp((size - threshold) / (SOFT_PART * (high - low)), 0, 1);
  return opacity * rise * rise * (3 - 2 * rise);
}

const hundredths = (value: number): number => Math.round(100 * value) / 100;
/** Values of layers are of any size. */
const short = (value: number): string => String(Number(value.toPrecision(4)));

/**
 * `blur`, or `blur,3,0.5`: threshold and opacity where they are not as at first, then the window and the colours if
 * others are chosen. Of an added layer both are always named; without a threshold its place is empty.
 */
export function overlayText({ name, threshold, opacity, window, colormap }: LayerOverlay): string {
  const usual = isMap(name) ? firstOverlay(name) : null;
  const parts = [
    name,
    threshold === null || threshold === usual?.threshold ? "" : short(threshold),
    opacity === usual?.opacity ? "" : String(hundredths(opacity)),
    ...(window ? window.map(short) : ["", ""]),
    colormap ?? "",
  ];
  return parts.join(",").replace(/,+$/, "");
}

/** The id of a layer that was added. */
export const isLayerId = (text: string): boolean => /^[0-9a-f]{32}$/.test(text);

/** The overlay of such a text, and whether all of it was taken as it is; null where it names no layer. */
export function readOverlay(text: string): { readonly overlay: LayerOverlay; readonly isWhole: boolean } | null {
  const [name = "", threshold = "", opacity = "", low = "", high = "", colours = "", ...rest] = text.split(",");
  if (!isMap(name) && !isLayerId(name)) return null;
  const first = isMap(name) ? firstOverlay(name) : { name, threshold: null, opacity: FIRST_OPACITY };
  const real = (part: string): number => (part.trim() === "" ? NaN : Number(part));
  const within = (part: string, usual: number, [least, most]: readonly [number, number]): number => {
    const value = real(part);
    return Number.isFinite(value) ? hundredths(clamp(value, least, most)) : usual;
  };
  const wanted = real(threshold);
  const ofLayer = Number.isFinite(wanted) ? wanted : null;
  const ofMap = first.threshold === null ? null : within(threshold, first.threshold, THRESHOLD_RANGE);
  const window: readonly [number, number] = [real(low), real(high)];
  const hasWindow = window.every(Number.isFinite) && window[0] < window[1];
  const colormap = OVERLAY_COLORMAPS.find((one) => one === colours);
  const overlay: LayerOverlay = {
    name,
    threshold: isMap(name) ? ofMap : ofLayer,
    opacity: within(opacity, first.opacity, [0, 1]),
    ...(hasWindow && { window }),
    ...(colormap && { colormap }),
  };
  const isKept = (part: string, value: number | null): boolean =>
    part === "" || (value !== null && Math.abs(Number(part) - value) <= 0.0051);
  const isWhole =
    rest.length === 0 &&
    isKept(threshold, overlay.threshold) &&
    isKept(opacity, overlay.opacity) &&
    hasWindow === (low + high !== "") &&
    (colormap ?? "") === colours;
  return { overlay, isWhole };
}

/** The keys of a picture with this layer over it, as the server names them. */
export function overlayPairs(overlay: LayerOverlay): readonly (readonly [string, string])[] {
  const { name, threshold, opacity, window, colormap } = overlay;
  const pairs: readonly (readonly [string, string | null | undefined])[] = [
    ["overlay", name],
    ["overlay_threshold", threshold === null ? null : String(threshold)],
    ["overlay_opacity", String(opacity)],
    ["overlay_window", window?.join()],
    ["overlay_colormap", colormap],
  ];
  return pairs.flatMap(([key, text]) => (text ? [[key, text] as const] : []));
}

/** Whether the score of a place is higher than those of heads without a lesion. */
export type Unusual = "yes" | "borderline" | "no";

/** About where a place is in other heads: to the right, to the front and upwards, in mm. */
export interface Standard {
  readonly mni152?: Vec3;
  readonly talairach?: Vec3;
  readonly error_mm?: number;
  readonly ac_pc?: Vec3;
}

/** A place that the server lists: see `candidates`. */
export interface Candidate {
  readonly position_in_patient: readonly [number, number, number];
  /** Null where a face of the volume that cuts the brain is near. */
  readonly depth_mm: number | null;
  readonly side: Side;
  readonly score: number;
  readonly size_mm: number;
  /** Absent if no limit is known for the map. */
  readonly unusual?: Unusual;
  /** About which gyrus it is in, where the server knows. */
  readonly gyrus?: string;
  readonly standard?: Standard;
}

/** The places that the server lists, the highest score first. */
export interface CandidateList {
  readonly candidates: readonly Candidate[];
  /** Whether no place of the cerebrum stands out; absent if no limit is known for the map. */
  readonly nothing_stands_out?: boolean;
  /** What is to be known about the scores before one is believed to be unusual. */
  readonly caveat?: { readonly reason: string; readonly reason_code: string };
  /** `review`: the cerebrum is not told from the rest of the brain. */
  readonly regions: {
    readonly state: "ok" | "review";
    readonly reasons: readonly string[];
    readonly reason_codes: readonly string[];
  };
}

/**
 * Whether a place is shown before the others are asked for. Most heads without a lesion have a borderline one. Where no limit is
 * known, all places are shown.
 */
export const standsOut = ({ unusual = "yes" }: Candidate): boolean => unusual === "yes";
