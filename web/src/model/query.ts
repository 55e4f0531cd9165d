// The server's pictures of a state.

import { short } from "./text.ts";
import { viewName } from "./camera.ts";
import { overlayPairs } from "./maps.ts";
import { type Plane, PLANES, type Vec2, type Vec3 } from "./space.ts";
import { type ViewState, LOOK, LOOK_KEYS, slabOf } from "./state.ts";
import type { MeshSize } from "./wire.ts";

/** The mesh of the page: 8,000 triangles. */
export const PAGE_MESH: MeshSize = { contour_count: 80, points_per_contour: 50 };
/** Vertices follow the gradient: deep down the paper's paths tear the mesh. */
export const MESH_PATHS = "paths=flow";
/** The same in a query. */
export const MESH_QUERY = `contours=${PAGE_MESH.contour_count}&points=${PAGE_MESH.points_per_contour}`;

function addColours(query: URLSearchParams, state: Pick<ViewState, "window" | "colormap" | "layer" | "overlay">): void {
  if (state.layer) query.set("layer", state.layer.id);
  query.set("window", `${Number(state.window.center.toPrecision(12))},${Number(state.window.width.toPrecision(12))}`);
  if (state.colormap !== "grey") query.set("colormap", state.colormap);
  for (const [key, text] of state.overlay ? overlayPairs(state.overlay) : []) query.set(key, text);
}

/** The query of a render of `size` pixels. */
export function renderQuery(state: ViewState, size: Vec2): URLSearchParams {
  const query = new URLSearchParams({ depth_mm: short(state.depth_mm, 2) });
  if (state.surface !== "whole") query.set("surface", state.surface);
  const name = viewName(state.orientation);
  if (name) query.set("view", name);
  else query.set("orientation", state.orientation.map((part) => short(part, 6)).join(","));
  if (state.zoom !== 1) query.set("zoom", short(state.zoom, 4));
  if (state.pan_mm.some((part) => part !== 0)) query.set("pan", state.pan_mm.map((part) => short(part, 2)).join(","));
  addColours(query, state);
  const look = { ...state, slab_mm: slabOf(state) };
  for (const key of LOOK_KEYS) if (look[key] !== 0 || LOOK[key].first !== 0) query.set(key, short(look[key], 3));
  query.set("renderer", state.way === "mesh" ? "mesh" : "trace");
  if (state.way === "mesh") {
    query.set("contours", String(PAGE_MESH.contour_count));
    query.set("points", String(PAGE_MESH.points_per_contour));
  }
  query.set("width", String(size[0]));
  query.set("height", String(size[1]));
  return query;
}

/** The query of the flat map in a picture of `size` pixels. */
export function mapQuery(state: ViewState, size: Vec2): URLSearchParams {
  const { zoom, pan_mm, has_inner } = state.map;
  const query = renderQuery({ ...state, zoom, pan_mm, way: "exact" }, size);
  for (const key of ["view", "orientation"]) query.delete(key);
  query.set("projection", "map");
  if (has_inner) query.set("sides", "both");
  return query;
}

/** The depths whose outlines a slice shows: that of the cut comes first. */
export const outlinesOf = ({
  depth_mm,
  outlines_mm,
}: Pick<ViewState, "depth_mm" | "outlines_mm">): readonly number[] => [
  depth_mm,
  ...outlines_mm.filter((other) => other !== depth_mm),
];

/** The query of the slice through `position_in_patient`, with the outlines of the cuts that the state names. */
export function sliceQuery(state: ViewState, plane: Plane, position_in_patient: Vec3, size: Vec2): URLSearchParams {
  const query = new URLSearchParams({ position_mm: short(position_in_patient[PLANES[plane].axis], 2) });
  addSlice(query, state, size);
  return query;
}

/** The query of the plane across the sulcus at a position, turned by so many degrees. */
export function acrossQuery(
  state: ViewState,
  [position, turn_deg]: readonly [Vec3, number],
  size: Vec2,
): URLSearchParams {
  const query = new URLSearchParams({
    position: position.map((part) => short(part, 2)).join(","),
    turn_deg: short(turn_deg, 1),
  });
  addSlice(query, state, size);
  if (state.convention === "neurological") query.set("convention", state.convention);
  return query;
}

/** What the queries of all slices have. */
function addSlice(query: URLSearchParams, state: ViewState, size: Vec2): void {
  const depths = outlinesOf(state).map((depth) => short(depth, 2));
  query.set("depth_mm", depths.join(","));
  if (state.surface !== "whole") query.set("surface", state.surface);
  addColours(query, state);
  query.set("width", String(size[0]));
  query.set("height", String(size[1]));
}

/**
 * The pixels to ask for so that a pane of CSS pixels looks sharp: whole steps, so that a cache helps, and not too
 * many.
 */
export function pictureSize(css: Vec2, devicePixelRatio: number, most: number): Vec2 {
  const larger = Math.max(...css, 1) * devicePixelRatio;
  const factor = devicePixelRatio * Math.min(1, most / larger);
  return [Math.max(Math.round(css[0] * factor), 16), Math.max(Math.round(css[1] * factor), 16)];
}

/** The depths of a text with commas, each once; null where it is no such text. */
export function readDepths(text: string, deepest_mm: number): readonly number[] | null {
  const parts = text.split(/[;,\s]+/).filter((part) => part !== "");
  const depths = [...new Set(parts.map(Number))];
  const isGood = depths.length > 0 && depths.every((depth) => depth >= 0 && depth <= deepest_mm);
  return isGood ? depths : null;
}
