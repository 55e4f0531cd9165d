// The maps of the junction of grey and white matter that lie in colours over a picture: pure.

/** The maps, as the server names them, in the order of the page. */
export const MAP_NAMES = ["blur", "asymmetry", "intensity-asymmetry", "sharpness", "junction"] as const;
export type MapName = (typeof MAP_NAMES)[number];

/** How the server shows a map if nothing else is asked for; a test compares this with its list of layers. */
export interface MapStyle {
  /** Empty where the values are shares. */
  readonly unit: "z" | "1/mm" | "";
  /** The values of the first and the last colour. */
  readonly window: readonly [number, number];
  readonly colormap: "vermilion-yellow" | "blue-orange" | "viridis";
  /** What is at most this is transparent; null: all that is defined is shown. */
  readonly threshold: number | null;
}

const ASYMMETRY: MapStyle = { unit: "z", window: [-6, 6], colormap: "blue-orange", threshold: 2.5 };
const styles: Readonly<Record<MapName, MapStyle>> = {
  blur: { unit: "z", window: [2.5, 5], colormap: "vermilion-yellow", threshold: 2.5 },
  asymmetry: ASYMMETRY,
  "intensity-asymmetry": ASYMMETRY,
  sharpness: { unit: "1/mm", window: [0, 0.6], colormap: "viridis", threshold: null },
  junction: { unit: "", window: [0, 1], colormap: "viridis", threshold: null },
};
export const styleOf = (name: MapName): MapStyle => styles[name];

/** Whether values count by their magnitude, so that both ends of the colours stand out. */
export const isDiverging = (name: MapName): boolean => styles[name].colormap === "blue-orange";

/** A map over the picture. */
export interface MapOverlay {
  readonly name: MapName;
  /** Null where the map has none. */
  readonly threshold: number | null;
  /** 0 to 1. */
  readonly opacity: number;
}

export const FIRST_OPACITY = 0.85;
/** Of maps that have a threshold. */
export const THRESHOLD_RANGE = [0, 6] as const;

/** A map as it is first shown. */
export const firstOverlay = (name: MapName): MapOverlay => ({
  name,
  threshold: styles[name].threshold,
  opacity: FIRST_OPACITY,
});

/** The map alone, or none where it is shown already. */
export const toggled = (shown: MapOverlay | null, name: MapName): MapOverlay | null =>
  shown?.name === name ? null : firstOverlay(name);

/** The part of the window over which a map fades in above its threshold. */
export const SOFT_PART = 0.1;

/** How much a value of a map hides of what is below it, 0 to 1: `render::layer`. */
export function shareOf({ name, threshold, opacity }: MapOverlay, value: number): number {
  const [low, high] = styles[name].window;
  if (threshold === null) return opacity;
  const size = isDiverging(name) ? Math.abs(value) : value;
  const rise = Math.min(Math.max((size - threshold) / (SOFT_PART * (high - low)), 0), 1);
  return opacity * rise * rise * (3 - 2 * rise);
}

const hundredths = (value: number): number => Math.round(100 * value) / 100;

/** `blur`, or `blur,3,0.5`: threshold and opacity where they are not as at first. */
export function overlayText({ name, threshold, opacity }: MapOverlay): string {
  const parts = [
    name,
    threshold === styles[name].threshold || threshold === null ? "" : String(hundredths(threshold)),
    opacity === FIRST_OPACITY ? "" : String(hundredths(opacity)),
  ];
  return parts.join(",").replace(/,+$/, "");
}

/** The overlay of such a text, and whether all of it was taken as it is; null where it names no map. */
export function readOverlay(text: string): { readonly overlay: MapOverlay; readonly isWhole: boolean } | null {
  const [word, threshold = "", opacity = "", ...rest] = text.split(",");
  const name = MAP_NAMES.find((one) => one === word);
  if (!name) return null;
  const first = firstOverlay(name);
  const within = (part: string, usual: number, [low, high]: readonly [number, number]): number => {
    const value = part.trim() === "" ? NaN : Number(part);
    return Number.isFinite(value) ? hundredths(Math.min(Math.max(value, low), high)) : usual;
  };
  const overlay = {
    name,
    threshold: first.threshold === null ? null : within(threshold, first.threshold, THRESHOLD_RANGE),
    opacity: within(opacity, first.opacity, [0, 1]),
  };
  const isKept = (part: string, value: number | null): boolean =>
    part === "" || (value !== null && Math.abs(Number(part) - value) <= 0.0051);
  const isWhole = rest.length === 0 && isKept(threshold, overlay.threshold) && isKept(opacity, overlay.opacity);
  return { overlay, isWhole };
}

/** The keys of a picture with this map over it, as the server names them. */
export function overlayPairs({ name, threshold, opacity }: MapOverlay): readonly (readonly [string, string])[] {
  return [
    ["overlay", name],
    ...(threshold === null ? [] : ([["overlay_threshold", String(threshold)]] as const)),
    ["overlay_opacity", String(opacity)],
  ];
}

/** A place that the server lists: see `candidates`. */
export interface Candidate {
  readonly position_in_patient: readonly [number, number, number];
  readonly depth_mm: number;
  readonly side: "left" | "right";
  readonly score: number;
  readonly size_mm: number;
}

/** Where a case's maps stand. */
export type MapsState =
  | { readonly state: "ready" | "making" }
  /** There are none, with the server's reason. */
  | { readonly state: "undefined" | "off"; readonly reason?: string };
