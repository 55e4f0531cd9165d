// Where a slice's pixels are in the patient: pure.

import { type Edges, NAMED_VIEWS, type Projection, type View, type ViewName, edgesOf, project } from "./camera.ts";
import type { ReadyCase, Sphere } from "./case.ts";
import { type Pinch, pan, pinch, zoomAt } from "./controls.ts";
import { type Vec2, type Vec3, clamp, PLANES, type Plane } from "./space.ts";
import type { Convention } from "./state.ts";

/** From where the server shows a slice: in the radiological manner. */
const SEEN_FROM: Readonly<Record<Plane, ViewName>> = { axial: "inferior", coronal: "anterior", sagittal: "left" };

/** Whether the page shows the server's picture flipped left to right. A sagittal slice has no side. */
export const isFlipped = (plane: Plane, convention: Convention): boolean =>
  convention === "neurological" && plane !== "sagittal";

/** The convention in which a picture is flipped. */
export const otherConvention = (convention: Convention): Convention =>
  convention === "radiological" ? "neurological" : "radiological";

export function sliceEdges(plane: Plane, convention: Convention): Edges {
  const edges = edgesOf(NAMED_VIEWS[SEEN_FROM[plane]]);
  return isFlipped(plane, convention) ? { ...edges, left: edges.right, right: edges.left } : edges;
}

export interface SliceView {
  readonly plane: Plane;
  readonly convention: Convention;
  readonly position_mm: number;
  readonly size: Vec2;
  /** How the slice lies in its pane, as the server shows it: before it is flipped. */
  readonly placing: Placing;
}

/** 1 shows a slice at the scale of the surface; the head moved to the right and up. */
export interface Placing {
  readonly zoom: number;
  readonly pan_mm: Vec2;
}

export const CENTRED: Placing = { zoom: 1, pan_mm: [0, 0] };

function projection(view: SliceView, sphere: Sphere): Projection {
  return project(sliceCamera(view), sphere, view.size);
}

/** The point at which a slice's camera looks. */
export const sliceCenter = ({ plane, position_mm }: SliceView, { center_in_patient }: Sphere): Vec3 =>
  center_in_patient.map((one, axis) => (axis === PLANES[plane].axis ? position_mm : one)) as unknown as Vec3;

export const sliceCamera = ({ plane, placing }: SliceView): View => ({
  ...placing,
  orientation: NAMED_VIEWS[SEEN_FROM[plane]],
});

/** A place or a move in the pane, as in the server's picture. */
const unflipped = (view: SliceView, [x, y]: Vec2, middle: number): Vec2 =>
  isFlipped(view.plane, view.convention) ? [2 * middle - x, y] : [x, y];

/** Where a slice lies after a drag by `move` pixels. */
export function movedSlice(view: SliceView, shown: ReadyCase, move: Vec2): Placing {
  const { zoom } = view.placing;
  return { zoom, ...pan(sliceCamera(view), shown, unflipped(view, move, 0), view.size) };
}

/** Where it lies when it is enlarged by `factor` about a place of the pane. */
export const zoomedSlice = (view: SliceView, shown: ReadyCase, factor: number, place: Vec2): Placing =>
  zoomAt(sliceCamera(view), shown, factor, unflipped(view, place, view.size[0] / 2), view.size);

/** Where it lies with a position in its middle. A whole head stays where it is as long as the position is in sight. */
export function followedSlice(view: SliceView, shown: ReadyCase, position_in_patient: Vec3): Placing {
  const [x, y] = slicePixel(view, shown.envelope_sphere, position_in_patient);
  const [width, height] = view.size;
  const isInSight = x >= 0 && x <= width && y >= 0 && y <= height;
  if (isInSight && view.placing.zoom <= CENTRED.zoom) return view.placing;
  return movedSlice(view, shown, [width / 2 - x, height / 2 - y]);
}

/** The same of two fingers. */
export function pinchedSlice(view: SliceView, shown: ReadyCase, { from, to }: Pinch): Placing {
  const both = ([a, b]: readonly [Vec2, Vec2]): readonly [Vec2, Vec2] => [
    unflipped(view, a, view.size[0] / 2),
    unflipped(view, b, view.size[0] / 2),
  ];
  return pinch(sliceCamera(view), shown, { from: both(from), to: both(to) }, view.size);
}

/** How a picture lies in its pane; only one of a standard plane may be flipped. */
export type Lying = Pick<SliceView, "placing" | "size"> & Partial<Pick<SliceView, "plane" | "convention">>;

/** How a picture of one placing is laid so that it shows another: scaled about its middle, then moved by pixels. */
export function laid(
  drawn: Lying,
  wanted: Lying,
  { radius_mm }: Sphere,
): { readonly scale: number; readonly move: Vec2 } {
  const mmPerPixel = ({ placing, size }: Lying): number => (2 * radius_mm) / (placing.zoom * Math.min(...size));
  const [before, now] = [mmPerPixel(drawn), mmPerPixel(wanted)];
  const scale = before / now;
  const [x, y] = [0, 1].map((axis) => {
    const [from, to] = [drawn.placing.pan_mm[axis] ?? 0, wanted.placing.pan_mm[axis] ?? 0];
    return to / now - (from / before) * scale;
  }) as [number, number];
  const { plane = "sagittal", convention = "radiological" } = wanted;
  return { scale, move: [isFlipped(plane, convention) ? -x : x, -y] };
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

/** The LPS coordinates along a patient axis that the volume reaches over, on whole half millimetres. */
export function reachOf({ volume }: ReadyCase, axis: 0 | 1 | 2): Vec2 {
  const row = volume.patient_from_voxel[axis] ?? [];
  const start = row[3] ?? 0;
  const ends = volume.size.map((count, column) => (row[column] ?? 0) * (count - 1));
  const low = start + ends.reduce((sum, end) => sum + Math.min(end, 0), 0);
  const high = start + ends.reduce((sum, end) => sum + Math.max(end, 0), 0);
  return [Math.ceil(low * 2) / 2, Math.floor(high * 2) / 2];
}

/** The nearest position that the volume reaches. */
export function withinReach(shown: ReadyCase, position: Vec3): Vec3 {
  return [
    clamp(position[0], ...reachOf(shown, 0)),
    clamp(position[1], ...reachOf(shown, 1)),
    clamp(position[2], ...reachOf(shown, 2)),
  ];
}
