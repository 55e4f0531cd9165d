// Layouts that a reader has saved by name: how a head is shown, and nothing of whose head it is. Pure.

import { NAMED_VIEWS, VIEW_NAMES, type ViewName, viewName } from "./camera.ts";
import type { ReadyCase } from "./case.ts";
import { laidOut } from "./commands.ts";
import type { Change } from "./controls.ts";
import { isMap, overlayText, readOverlay } from "./maps.ts";
import {
  COLORMAPS,
  CONVENTIONS,
  type Colormap,
  type Convention,
  LAYOUTS,
  type Layout,
  type ViewState,
  boundOutlines,
  clampDepth,
} from "./state.ts";
import { SURFACES, type SurfaceName } from "./surfaces.ts";
import { parsed, plainLine } from "./text.ts";

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
}

/** A name as it is kept. */
export const boundName = (name: string): string => plainLine(name, LONGEST_NAME);

export const savedAs = (name: string, state: ViewState): SavedLayout => ({
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
});

/** The change to a saved layout: the marked point, the window and the layers of the patient stay, and what it does not say. */
export function recalled(saved: Partial<SavedLayout>, state: ViewState, shown: ReadyCase): Change {
  const { layout, depth_mm, map, view, colormap, convention, outlines_mm, surface, has_inner } = {
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
    colormap,
    convention,
    outlines_mm: boundOutlines(outlines_mm, shown),
  };
}

/** The stored text as layouts; what is not understood is left out. */
export function readLayouts(text: string | null): readonly SavedLayout[] {
  const stored = parsed(text);
  return (Array.isArray(stored) ? stored : []).flatMap((one: unknown) => readLayout(one) ?? []).slice(0, MOST_LAYOUTS);
}

function readLayout(stored: unknown): SavedLayout | null {
  if (typeof stored !== "object" || stored === null) return null;
  const one: Partial<Record<keyof SavedLayout, unknown>> = stored;
  const name = typeof one.name === "string" ? boundName(one.name) : "";
  const layout = LAYOUTS.find((known) => known === one.layout);
  if (name === "" || !layout || typeof one.depth_mm !== "number" || !Number.isFinite(one.depth_mm)) return null;
  const map = typeof one.map === "string" ? readOverlay(one.map) : null;
  const depths = Array.isArray(one.outlines_mm) ? one.outlines_mm : [];
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
  };
}
