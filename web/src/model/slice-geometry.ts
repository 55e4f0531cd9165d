// Where a slice's pixels are in the patient: pure.

import { type Edges, NAMED_VIEWS, type Projection, type ViewName, edgesOf, project } from "./camera.ts";
import type { ReadyCase, Sphere } from "./case.ts";
import { PLANES, type Plane } from "./query.ts";
import type { Vec2, Vec3 } from "./space.ts";
import { type Convention, clamp } from "./state.ts";

/** From where the server shows a slice: in the radiological manner. */
const SEEN_FROM: Readonly<Record<Plane, ViewName>> = { axial: "inferior", coronal: "anterior", sagittal: "left" };

/** Whether the page shows the server's picture flipped left to right. A sagittal slice has no side. */
export const isFlipped = (plane: Plane, convention: Convention): boolean =>
  convention === "neurological" && plane !== "sagittal";

export function sliceEdges(plane: Plane, convention: Convention): Edges {
  const edges = edgesOf(NAMED_VIEWS[SEEN_FROM[plane]]);
  return isFlipped(plane, convention) ? { ...edges, left: edges.right, right: edges.left } : edges;
}

/** A slice in its pane. */
export interface SliceView {
  readonly plane: Plane;
  readonly convention: Convention;
  readonly position_mm: number;
  readonly size: Vec2;
}

function projection(view: SliceView, sphere: Sphere): Projection {
  return project({ orientation: NAMED_VIEWS[SEEN_FROM[view.plane]], zoom: 1, pan_mm: [0, 0] }, sphere, view.size);
}

/** The pixel of the pane at which a position is seen, if it lay in the slice. */
export function slicePixel(view: SliceView, sphere: Sphere, position_in_patient: Vec3): Vec2 {
  const [x, y] = projection(view, sphere).pixelOf(position_in_patient);
  return [isFlipped(view.plane, view.convention) ? view.size[0] - x : x, y];
}

/** The position in the slice at a pixel of the pane. */
export function slicePosition(view: SliceView, sphere: Sphere, [x, y]: Vec2): Vec3 {
  const column = isFlipped(view.plane, view.convention) ? view.size[0] - x : x;
  const place = projection(view, sphere).positionOf([column, y, 0]);
  const { axis } = PLANES[view.plane];
  return [0, 1, 2].map((one) => (one === axis ? view.position_mm : (place[one] ?? 0))) as unknown as Vec3;
}

export const sliceMmPerPixel = (view: SliceView, sphere: Sphere): number => projection(view, sphere).mm_per_pixel;

/** The LPS coordinates along a patient axis that the working grid reaches over, on whole half millimetres. */
export function reachOf(shown: ReadyCase, axis: 0 | 1 | 2): Vec2 {
  const row = shown.grid.patient_from_voxel[axis] ?? [];
  const start = row[3] ?? 0;
  const ends = shown.grid.size.map((count, column) => (row[column] ?? 0) * (count - 1));
  const low = start + ends.reduce((sum, end) => sum + Math.min(end, 0), 0);
  const high = start + ends.reduce((sum, end) => sum + Math.max(end, 0), 0);
  return [Math.ceil(low * 2) / 2, Math.floor(high * 2) / 2];
}

/** The nearest position that the grid reaches. */
export function withinReach(shown: ReadyCase, position: Vec3): Vec3 {
  return [
    clamp(position[0], ...reachOf(shown, 0)),
    clamp(position[1], ...reachOf(shown, 1)),
    clamp(position[2], ...reachOf(shown, 2)),
  ];
}
