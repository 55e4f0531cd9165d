// What is shown, as plain values: readonly data in, new data out.

import { NAMED_VIEWS } from "./camera.ts";
import { FIRST_MAP, type MapView } from "./flat-map.ts";
import type { Intensity, ReadyCase, Window } from "./case.ts";
import type { GreyLayer, LayerOverlay } from "./maps.ts";
import { type Plane, type Quat, type Vec2, type Vec3, clamp } from "./space.ts";
import { type SurfaceName, mirroredSurface } from "./surfaces.ts";

/** The colour maps, as the server names them. */
export const COLORMAPS = ["grey", "inverted", "bone", "hot", "viridis"] as const;
export type Colormap = (typeof COLORMAPS)[number];

/** Who draws the surface: whichever of the two here suits, the shrunk mesh, sphere tracing, or the server. */
export const WAYS = ["auto", "mesh", "exact", "server"] as const;
export type Way = (typeof WAYS)[number];

/**
 * Which panes there are: the surface alone; with three slices; beside the other hemisphere, mirrored; both; or a
 * close-up of the marked place in slices; or the flat map of both hemispheres beside the surface.
 */
export const LAYOUTS = ["single", "slices", "mirror", "both", "closer", "map"] as const;
export type Layout = (typeof LAYOUTS)[number];

/** Whether the surface is seen beside the other hemisphere, mirrored. */
export const isMirrored = ({
  layout,
  beside,
}: {
  readonly layout: Layout;
  readonly beside?: HalfLook | null;
}): boolean => !beside && (layout === "mirror" || layout === "both");
/** Whether the pane has two halves: the mirrored one is the right one, or each has layers of its own. */
export const isHalved = (state: ViewState): boolean => state.beside !== null || isMirrored(state);
/**
 * Whether the mirrored half lies below the other one: each is larger then, for the head fits its smaller side. Halves with
 * layers of their own are the left one and the right one, by name.
 */
export const isStacked = (state: ViewState, [width, height]: Vec2): boolean => isMirrored(state) && width < height;
/** The size of the picture of one view in a pane: of one of its halves, where it has two. */
export function viewSize(state: ViewState, [width, height]: Vec2): Vec2 {
  if (!isHalved(state)) return [width, height];
  return isStacked(state, [width, height]) ? [width, height / 2] : [width / 2, height];
}
/** The panes that can show a series of their own, each with its letter in the address. The three slices may all have one plane. */
export const SLOTS = { surface: "S", "slice-1": "A", "slice-2": "B", "slice-3": "C", across: "X", map: "M" } as const;
export type Slot = keyof typeof SLOTS;
export const SLOT_NAMES = Object.keys(SLOTS) as readonly Slot[];
export const SLICE_SLOTS = ["slice-1", "slice-2", "slice-3"] as const satisfies readonly Slot[];

/** So many layers and maps are shown at once, and kept here and on the device. */
export const MOST_SHOWN = 8;

export const hasSlices = ({ layout }: Pick<ViewState, "layout">): boolean => layout === "slices" || layout === "both";

/** How axial and coronal slices are shown: the patient's right at the picture's left, or at its right. */
export const CONVENTIONS = ["radiological", "neurological"] as const;
export type Convention = (typeof CONVENTIONS)[number];

export interface Swipe {
  /** From the left edge of each pane, of its width. */
  readonly share: number;
}

/** What each half of the pane has of its own when two are compared side by side. */
export type HalfLook = Pick<ViewState, "layer" | "overlay" | "window" | "colormap">;

/** What a pane shows of its own; once it is drawn, also how its layer is compared with the picture without it. */
export type PaneLook = HalfLook & Partial<Pick<ViewState, "bare_window" | "swipe" | "has_edges">>;

/** Whose look is meant: a pane's own, that of the left half, or that of all panes without their own. */
export type Place = Slot | "left" | "all";

/**
 * The numbers of what a picture looks like, by their keys on the server, whose defaults are the first ones: from 0 to `most`, without
 * any effect if `plain`, and in the address under a letter with so many digits.
 */
export const LOOK = {
  /** Intensities are averaged over so much depth to either side, in mm. */
  slab_mm: { most: 20, first: 0, plain: 0, letter: "s", digits: 1 },
  /** The share of light that reaches every face; 1 is no shading. */
  ambient: { most: 1, first: 0.3, plain: 1, letter: "a", digits: 2 },
} as const;
export const LOOK_KEYS = Object.keys(LOOK) as readonly (keyof typeof LOOK)[];
export type LookNumbers = Readonly<Record<keyof typeof LOOK, number>>;

export const lookNumbers = (which: "first" | "plain"): LookNumbers =>
  Object.fromEntries(LOOK_KEYS.map((key) => [key, LOOK[key][which]])) as LookNumbers;

export interface ViewState extends LookNumbers {
  /** The surface below which depth is measured. */
  readonly surface: SurfaceName;
  /** Below the envelope, 0 to the case's greatest depth. */
  readonly depth_mm: number;
  /** From patient to view space, as the server's `orientation`. */
  readonly orientation: Quat;
  /** 1 fits the envelope's sphere into the smaller side of the pane. */
  readonly zoom: number;
  /** The head moved to the right and up. */
  readonly pan_mm: Vec2;
  readonly window: Window;
  readonly colormap: Colormap;
  /** The layer in the place of the intensities; the window is then one of its values. */
  readonly layer: GreyLayer | null;
  /** The layer in colours over the surface and the slices. */
  readonly overlay: LayerOverlay | null;
  /** The left half, which is compared side by side with the right half: the rest of the state; null: there is none. */
  readonly beside: HalfLook | null;
  /** What panes show that have a series of their own; the others show what the state says. */
  readonly panes: Readonly<Partial<Record<Slot, PaneLook>>>;
  /** The plane of all three slices; null: each has its own. */
  readonly plane: Plane | null;
  /** Where a line divides the picture without its layers from the picture with them; null: nowhere. */
  readonly swipe: Swipe | null;
  /** Whether slices show a layer as its edges alone, over the case's own intensities. */
  readonly has_edges: boolean;
  /** The window of what is drawn without a layer beside one or below its edges, if it is not that of the layer. */
  readonly bare_window?: Window;
  /** Whether they are averaged near the envelope although `slab_mm` is 0: see `slabOf`. */
  readonly averages_shallow: boolean;
  readonly way: Way;
  readonly layout: Layout;
  readonly map: MapView;
  readonly convention: Convention;
  /** Depths whose outlines the slices show besides that of `depth_mm`. */
  readonly outlines_mm: readonly number[];
  /** The position that was picked, in the patient; the slices go through it. */
  readonly crosshair_mm: Vec3 | null;
  /** By how much the slice across the sulcus at that position is turned, in degrees; null: it is not shown. */
  readonly across_deg: number | null;
  /** The diameter of the listed place at that position, if the map that is shown does not colour it. */
  readonly place_mm?: number;
}

export const ZOOM_RANGE = [0.25, 20] as const;
export const PAN_LIMIT_MM = 300;
export const DEPTH_STEP_MM = 0.5;
export const FINE_DEPTH_STEP_MM = 0.1;
/** From about 6 to 20 mm the cuts are orthogonal to most of the sulci. */
export const GOOD_DEPTHS_MM = [6, 20] as const;
export const FIRST_DEPTH_MM = 10;

/** How a ready case is first shown. */
export function firstState(shown: ReadyCase): ViewState {
  return {
    surface: "whole",
    depth_mm: clampDepth(FIRST_DEPTH_MM, shown),
    orientation: NAMED_VIEWS.left,
    zoom: 1,
    pan_mm: [0, 0],
    window: { center: shown.intensity.window.center, width: shown.intensity.window.width },
    colormap: "grey",
    layer: null,
    overlay: null,
    beside: null,
    panes: {},
    plane: null,
    swipe: null,
    has_edges: false,
    ...lookNumbers("first"),
    averages_shallow: true,
    way: "auto",
    layout: "single",
    map: FIRST_MAP,
    convention: "radiological",
    outlines_mm: [],
    crosshair_mm: null,
    across_deg: null,
  };
}

/** A depth that the case has, to a hundredth of a millimetre; what is no number is 0. */
export function clampDepth(depth_mm: number, shown: ReadyCase): number {
  const deepest = Math.floor(shown.max_depth_mm * 100) / 100;
  return Math.round(clamp(depth_mm || 0, 0, deepest) * 100) / 100;
}

/** What the right half shows, or the whole where nothing is beside it. */
export const halfOf = ({ layer, overlay, window, colormap }: HalfLook): HalfLook => ({
  layer,
  overlay,
  window,
  colormap,
});
/** What the left half shows, or the whole where nothing is beside it. */
export const leftOf = (state: ViewState): ViewState => ({ ...state, ...state.beside });

const namesOf = ({ layer, overlay }: HalfLook): readonly string[] => [layer?.id ?? [], overlay?.name ?? []].flat();

/** The layers of a picture with its halves, by name or id. */
export const layersOf = (state: ViewState): readonly string[] => [state, leftOf(state)].flatMap(namesOf);

const seenIn = new WeakMap<ViewState, Map<Slot, ViewState>>();

/** What a pane shows: the same object as long as the state is the same. */
export function stateIn(state: ViewState, slot: Slot): ViewState {
  const own = state.panes[slot];
  if (!own) return state;
  const known = seenIn.get(state) ?? new Map<Slot, ViewState>();
  seenIn.set(state, known);
  const seen = known.get(slot) ?? { ...state, ...own };
  known.set(slot, seen);
  return seen;
}

/** The panes of a layout that can show a series of their own. */
export function slotsOf({ layout, across_deg, crosshair_mm }: ViewState): readonly Slot[] {
  if (layout === "closer") return [];
  if (layout === "map") return ["surface", "map"];
  if (!hasSlices({ layout })) return ["surface"];
  return ["surface", ...SLICE_SLOTS, ...(across_deg !== null && crosshair_mm ? (["across"] as const) : [])];
}

/** What the panes of the layout show. */
export function seenOf(state: ViewState): readonly ViewState[] {
  const slots = slotsOf(state);
  return slots.length > 0 ? slots.map((slot) => stateIn(state, slot)) : [state];
}

/** The panes to be named where they show different series; halves beside each other are named as such. */
export function namedSlots(state: ViewState): readonly Slot[] {
  const slots = slotsOf(state);
  if (slots.length < 2 || !slots.some((slot) => state.panes[slot])) return [];
  return slots.filter((slot) => slot !== "surface" || !state.beside);
}

/** The layers of all panes, each once. */
export const allLayersOf = (state: ViewState): readonly string[] => [...new Set(seenOf(state).flatMap(layersOf))];

/** Where a series goes that is meant for a pane: a pane alone shows what all show. */
export function placeOf(state: ViewState, asked: Place | null): Place {
  if (asked === "left") return state.beside ? "left" : "all";
  const slots = slotsOf(state);
  if (asked === null || asked === "all" || !slots.includes(asked)) return "all";
  return slots.length > 1 || state.panes[asked] ? asked : "all";
}

/** What is seen at a place. */
export function lookAt(state: ViewState, place: Place): HalfLook {
  if (place === "all") return halfOf(state);
  return halfOf(place === "left" ? leftOf(state) : stateIn(state, place));
}

/** The change after which a place has a look. */
export function withLook(state: ViewState, place: Place, look: HalfLook): Partial<ViewState> {
  if (place === "all") return look;
  return place === "left" ? { beside: look } : { panes: { ...state.panes, [place]: look } };
}

/** The surfaces that a picture shows: beside the mirrored half of one half, the other half too. */
export const surfacesOf = (state: ViewState): readonly SurfaceName[] => {
  const other = mirroredSurface(state.surface);
  return isMirrored(state) && other !== state.surface ? [state.surface, other] : [state.surface];
};

export const bareOf = (state: ViewState): ViewState => ({
  ...state,
  window: state.bare_window ?? state.window,
  layer: null,
  overlay: null,
  swipe: null,
});

/** The parts of a picture, and from where to where they go, in shares of its width. */
export function partsOf(state: ViewState): readonly (readonly [ViewState, readonly [number, number]])[] {
  const { swipe } = state;
  if (!swipe) return [[state, [0, 1]]];
  return [
    [bareOf(state), [0, swipe.share]],
    [state, [swipe.share, 1]],
  ];
}

/** The layer that slices show as edges, with the window of its values; labels have none. */
export function edgesLayer({ has_edges, layer, overlay, window }: ViewState): LayerOverlay | null {
  if (!has_edges) return null;
  if (layer) return { name: layer.id, threshold: null, opacity: 1, window: windowEnds(window), moved: layer.moved };
  return overlay?.about?.colormap === "labels" ? null : overlay;
}

/** What the values of a picture's texture are: of its layer, else of the case. */
export const textureOf = (state: Pick<ViewState, "layer">, shown: ReadyCase): { readonly intensity: Intensity } => ({
  intensity: state.layer?.intensity ?? shown.intensity,
});

/** The most outlines on a slice besides that of the cut. */
export const MOST_OUTLINES = 7;

/** The depths that outlines can have, each once, the shallowest first. */
export const boundOutlines = (depths_mm: readonly number[], shown: ReadyCase): readonly number[] =>
  [...new Set(depths_mm.filter((depth) => depth >= 0 && depth <= clampDepth(Infinity, shown)))]
    .sort((a, b) => a - b)
    .slice(0, MOST_OUTLINES);

/** The depth `steps` steps further, on whole steps: from 8.3 mm one step of 0.5 mm goes to 8.5 mm. */
export function stepDepth(depth_mm: number, steps: number, step_mm: number): number {
  const place = depth_mm / step_mm;
  const near = Math.round(place);
  // Off the steps, the next one in that direction is the first step.
  const from = Math.abs(place - near) < 1e-6 ? near : steps > 0 ? Math.floor(place) : Math.ceil(place);
  return Math.round((from + steps) * step_mm * 100) / 100;
}

/**
 * The intensities that a window shows black and white: DICOM's linear window (PS3.3 C.11.2.1.2.1) goes from one to
 * the other in `width − 1`.
 */
export function windowEnds({ center, width }: Window): readonly [number, number] {
  const half = (Math.max(width, 1) - 1) / 2;
  return [center - 0.5 - half, center - 0.5 + half];
}

/** The window that shows one intensity black and another white. */
export const windowBetween = (black: number, white: number): Window => ({
  center: (black + white + 1) / 2,
  width: white - black + 1,
});

/** The window of a named preset, of the case's own window and range. */
export const WINDOW_PRESETS = ["auto", "full", "brain", "narrow", "bright", "dark"] as const;
export type WindowPreset = (typeof WINDOW_PRESETS)[number];

export function presetWindow(preset: WindowPreset, { intensity }: { readonly intensity: Intensity }): Window {
  const { min, max, window } = intensity;
  const [black, white] = windowEnds(window);
  const width = white - black;
  switch (preset) {
    case "auto":
      return window;
    case "full":
      return windowBetween(min, Math.max(max, min + width * 1e-3));
    // Cerebrospinal fluid, the darkest quarter, is black: what is left goes to grey and white matter.
    case "brain":
      return windowBetween(black + 0.3 * width, white);
    case "narrow":
      return windowBetween(black + 0.525 * width, black + 0.875 * width);
    case "bright":
      return windowBetween(black, black + 0.7 * width);
    case "dark":
      return windowBetween(black + 0.4 * width, black + 1.4 * width);
  }
}

/** Layers thinner than two voxels lie near the envelope: undersampled, they show as rings like those of wood. */
const SHALLOW_MM = [1, 2] as const;

/** Over how much depth intensities are averaged near the envelope: 1 mm, fading out from 1 to 2 mm of depth. */
export const shallowMean = (depth_mm: number): number => clamp(SHALLOW_MM[1] - depth_mm, 0, SHALLOW_MM[0]);

/**
 * The slab that a state is drawn with: its own, or near the envelope one that is `shallowMean` thick. Above the
 * envelope there is nothing, so that at a depth of 0 all of it is below.
 */
export function slabOf({
  slab_mm,
  averages_shallow,
  depth_mm,
}: Pick<ViewState, "slab_mm" | "averages_shallow" | "depth_mm">): number {
  if (slab_mm > 0 || !averages_shallow) return slab_mm;
  const mean_mm = shallowMean(depth_mm);
  return mean_mm === 0 ? 0 : Math.max(mean_mm / 2, mean_mm - depth_mm);
}
