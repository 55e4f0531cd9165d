// Layouts that a reader has saved by name: how a head is shown, and nothing of whose head it is. Pure.

import { NAMED_VIEWS, VIEW_NAMES, type ViewName, viewName } from "./camera.ts";
import type { ReadyCase } from "./case.ts";
import { laidOut } from "./commands.ts";
import type { Change } from "./controls.ts";
import {
  CONTRASTS,
  type Contrast,
  LAYER_KINDS,
  type Layer,
  type LayerKind,
  greyOf,
  isReady,
  overlayOf,
} from "./layers.ts";
import { isMap, overlayText, readOverlay } from "./maps.ts";
import {
  COLORMAPS,
  CONVENTIONS,
  type Colormap,
  type Convention,
  LAYOUTS,
  type HalfLook,
  type Layout,
  SLOT_NAMES,
  type Slot,
  type ViewState,
  boundOutlines,
  clampDepth,
  firstState,
  halfOf,
} from "./state.ts";
import { PLANE_NAMES, type Plane } from "./space.ts";
import { SURFACES, type SurfaceName } from "./surfaces.ts";
import { plainLine } from "./text.ts";

/** As many as there are keys. */
export const MOST_LAYOUTS = 9;
export const LONGEST_NAME = 40;

export interface SavedLayout {
  readonly name: string;
  readonly layout: Layout;
  readonly depth_mm: number;
  /** A map, as the address writes it; empty: none. Layers that were added belong to a patient. */
  readonly map: string;
  /** Null where the head was turned freely. */
  readonly view: ViewName | null;
  readonly colormap: Colormap;
  readonly convention: Convention;
  readonly outlines_mm: readonly number[];
  readonly surface: SurfaceName;
  readonly has_inner: boolean;
  /**
   * What panes show that have a series of their own: a map, as the address writes it, or the contrast or the kind of a layer, of which
   * another case has the newest, or one over the other, after a bar; `own` is the case itself.
   */
  readonly series: Readonly<Partial<Record<Slot, string>>>;
  /** The plane of all slices; null: each has its own. */
  readonly plane: Plane | null;
}

/** What layers can be found by in any case. Others, such as the map of another program, are one patient's. */
const FOUND_BY = [...CONTRASTS, ...LAYER_KINDS].filter((one) => !/^(other|mr|map|labels)$/.test(one));
const OWN = "own";
/** Before the contrast or the kind of a layer in grey, or in colours: there is a map of the name of one. */
const LAYER = "layer:";
const COLOURS = "colours:";

const foundBy = ({ contrast, kind }: Layer): string | null =>
  FOUND_BY.find((one) => one === contrast) ?? FOUND_BY.find((one) => one === kind) ?? null;

/** What is kept of the series of a pane; null: it is one patient's. */
function kept({ layer, overlay }: HalfLook, layers: readonly Layer[]): string | null {
  const found = (start: string, id: string): string | null => {
    const one = layers.find((other) => other.id === id);
    const by = one && foundBy(one);
    return by ? start + by : null;
  };
  if (!layer && !overlay) return OWN;
  const over = overlay && (isMap(overlay.name) ? overlayText(overlay) : found(COLOURS, overlay.name));
  return [layer && found(LAYER, layer.id), over].filter(Boolean).join("|") || null;
}

/** What a part of a kept series changes in a case; null if the case has none. */
function partOf(text: string, layers: readonly Layer[]): Partial<HalfLook> | null {
  const overlay = readOverlay(text)?.overlay;
  if (overlay) return { overlay };
  if (text === OWN) return {};
  const [start, by] = text.split(":");
  const newest = layers.findLast((one) => isReady(one) && foundBy(one) === by);
  if (newest && `${start}:` === COLOURS) return { overlay: overlayOf(newest) };
  const layer = newest && greyOf(newest);
  return layer ? { layer, window: layer.intensity.window } : null;
}

/** The look of a kept series in a case; null if the case has not all of it. */
function lookOf(text: string, shown: ReadyCase, layers: readonly Layer[]): HalfLook | null {
  const parts = text.split("|").map((part) => partOf(part, layers));
  return parts.includes(null) ? null : Object.assign(halfOf(firstState(shown)), ...parts);
}

/** The contrasts and kinds of the layers that a layout has in panes, and a case has not. */
export function missingOf(
  { series }: Pick<SavedLayout, "series">,
  layers: readonly Layer[],
): readonly (Contrast | LayerKind)[] {
  const parts = Object.values(series).flatMap((text) => text.split("|"));
  const missing = parts.filter((part) => partOf(part, layers) === null).map((part) => part.split(":")[1]);
  return FOUND_BY.filter((one) => missing.includes(one));
}

const isSeries = (text: string): boolean =>
  text.split("|").every((part) => {
    const read = readOverlay(part);
    if (read) return isMap(read.overlay.name);
    return part === OWN || FOUND_BY.some((one) => part === LAYER + one || part === COLOURS + one);
  });

/** A value for each pane that has one. */
const perSlot = <Value>(valueOf: (slot: Slot) => Value | null): Partial<Record<Slot, Value>> =>
  Object.fromEntries(SLOT_NAMES.map((slot) => [slot, valueOf(slot)]).filter(([, value]) => value !== null));

/** A name as it is kept. */
export const boundName = (name: string): string => plainLine(name, LONGEST_NAME);

export const savedAs = (name: string, state: ViewState, layers: readonly Layer[] = []): SavedLayout => ({
  name: boundName(name),
  layout: state.layout,
  depth_mm: state.depth_mm,
  map: state.overlay && isMap(state.overlay.name) ? overlayText(state.overlay) : "",
  view: viewName(state.orientation),
  colormap: state.colormap,
  convention: state.convention,
  outlines_mm: state.outlines_mm,
  surface: state.surface,
  has_inner: state.map.has_inner,
  series: perSlot((slot) => {
    const own = state.panes[slot];
    return own ? kept(own, layers) : null;
  }),
  plane: state.plane,
});

/** The change to a saved layout: the marked point, the window and the layers of the patient stay, and what it does not say. */
export function recalled(
  saved: Partial<SavedLayout>,
  state: ViewState,
  shown: ReadyCase,
  layers: readonly Layer[] = [],
): Change {
  const { layout, depth_mm, map, view, colormap, convention, outlines_mm, surface, has_inner, series, plane } = {
    ...savedAs("", state),
    ...saved,
  };
  const turned = view && !state.crosshair_mm ? { orientation: NAMED_VIEWS[view], pan_mm: [0, 0] as const } : {};
  return {
    surface,
    ...turned,
    ...laidOut(layout, { ...state, ...turned, surface }, shown),
    depth_mm: clampDepth(depth_mm, shown),
    overlay: readOverlay(map)?.overlay ?? null,
    map: { ...state.map, has_inner },
    panes: perSlot((slot) => {
      const text = series[slot];
      return text === undefined ? null : lookOf(text, shown, layers);
    }),
    plane,
    colormap,
    convention,
    outlines_mm: boundOutlines(outlines_mm, shown),
  };
}

/** What is stored as layouts; what is not understood is left out. A name that comes again gets a number. */
export function readLayouts(stored: unknown): readonly SavedLayout[] {
  const all = (Array.isArray(stored) ? stored : []).flatMap((one: unknown) => readLayout(one) ?? []);
  const names = new Set<string>();
  return all.slice(0, MOST_LAYOUTS).map((one) => {
    let { name } = one;
    for (let at = 2; names.has(name); at += 1) name = `${plainLine(one.name, LONGEST_NAME - 2)} ${at}`;
    names.add(name);
    return { ...one, name };
  });
}

function readLayout(stored: unknown): SavedLayout | null {
  if (typeof stored !== "object" || stored === null) return null;
  const one: Partial<Record<keyof SavedLayout, unknown>> = stored;
  const name = typeof one.name === "string" ? boundName(one.name) : "";
  const layout = LAYOUTS.find((known) => known === one.layout);
  if (name === "" || !layout || typeof one.depth_mm !== "number" || !Number.isFinite(one.depth_mm)) return null;
  const map = typeof one.map === "string" ? readOverlay(one.map) : null;
  const depths = Array.isArray(one.outlines_mm) ? one.outlines_mm : [];
  const series: Partial<Record<string, unknown>> =
    typeof one.series === "object" && one.series !== null ? { ...one.series } : {};
  return {
    name,
    layout,
    depth_mm: one.depth_mm,
    map: map && isMap(map.overlay.name) ? overlayText(map.overlay) : "",
    view: VIEW_NAMES.find((known) => known === one.view) ?? null,
    colormap: COLORMAPS.find((known) => known === one.colormap) ?? "grey",
    convention: CONVENTIONS.find((known) => known === one.convention) ?? "radiological",
    outlines_mm: depths.filter((depth): depth is number => typeof depth === "number" && Number.isFinite(depth)),
    surface: SURFACES.find((known) => known === one.surface) ?? "whole",
    has_inner: one.has_inner === true,
    series: perSlot((slot) => {
      const text = series[slot];
      return typeof text === "string" && isSeries(text) ? text : null;
    }),
    plane: PLANE_NAMES.find((known) => known === one.plane) ?? null,
  };
}
