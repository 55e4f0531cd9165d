// The flat map of the cortex, as the server's `render::map`: each hemisphere as an equal-area disc of the directions from its
// middle.

import type { MirrorPlane } from "./case.ts";
import {
  type Vec2,
  type Vec3,
  add,
  cross,
  distance,
  dot,
  length,
  normalized,
  scale,
  subtract,
  transform,
} from "./space.ts";
import type { SurfaceName } from "./surfaces.ts";
import type { Block } from "./wire.ts";

/** Radii of the rim of a disc, 90° from its axis, and of the end of its margin at 115°, in radii of the sphere of directions. */
export const MAP_RIM = Math.SQRT2;
export const MAP_MARGIN = 2 * Math.sin((57.5 * Math.PI) / 180);
/** The radius of the sphere that a map is drawn as, to which its pan refers. */
export const MAP_RADIUS_MM = 70;
/** The side of the square around a disc, in radii of the sphere. */
const CELL = 3.5;

export const HEMISPHERES = ["left", "right"] as const;
export type Hemisphere = (typeof HEMISPHERES)[number];
export type MapFace = "outer" | "inner";

/** The middles of the hemispheres, where the lines of sight end. */
export type Centres = Readonly<Record<Hemisphere, Vec3>>;

export interface MapView {
  /** 1 fits the map into its pane. */
  readonly zoom: number;
  /** The map moved to the right and up, as a sphere of 70 mm. */
  readonly pan_mm: Vec2;
  /** Whether the inner sides are shown below the outer ones. */
  readonly has_inner: boolean;
}

export const FIRST_MAP: MapView = { zoom: 1, pan_mm: [0, 0], has_inner: false };

/** The centroids of the voxels of an envelope on either side of the plane between the hemispheres; null if a side has none. */
export function* centresOf(
  { voxels, size, patient_from_voxel }: Block<Int16Array<ArrayBuffer>>,
  { normal, offset_mm }: MirrorPlane,
): Generator<void, Centres | null> {
  const sums = { left: [0, 0, 0, 0], right: [0, 0, 0, 0] };
  const at = (voxel: Vec3): Vec3 => transform(patient_from_voxel, voxel);
  const origin = at([0, 0, 0]);
  const step = dot(normal, subtract(at([1, 0, 0]), origin));
  let index = 0;
  for (let z = 0; z < size[2]; z += 1) {
    for (let y = 0; y < size[1]; y += 1) {
      const first = dot(normal, at([0, y, z])) - offset_mm;
      for (let x = 0; x < size[0]; x += 1, index += 1) {
        // Border voxels have depth 0.
        if ((voxels[index] ?? -1) < 0) continue;
        const away = first + x * step;
        if (away === 0) continue;
        const sum = away > 0 ? sums.left : sums.right;
        sum[0] = (sum[0] ?? 0) + x;
        sum[1] = (sum[1] ?? 0) + y;
        sum[2] = (sum[2] ?? 0) + z;
        sum[3] = (sum[3] ?? 0) + 1;
      }
    }
    yield;
  }
  const middle = ([x = 0, y = 0, z = 0, count = 0]: readonly number[]): Vec3 | null =>
    count > 0 ? at([x / count, y / count, z / count]) : null;
  const [left, right] = [middle(sums.left), middle(sums.right)];
  return left && right && { left, right };
}

export interface Disc {
  readonly hemisphere: Hemisphere;
  readonly face: MapFace;
  readonly center_in_patient: Vec3;
  /** The patient's directions to the right of the disc, up, and to the viewer. */
  readonly axes: readonly [Vec3, Vec3, Vec3];
  /** Its centre to the right of and above the centre of the map, and the map's size, in radii of the sphere. */
  readonly offset: Vec2;
  readonly extent: Vec2;
}

/** The surface that a disc shows: the outer sides are those of the whole brain, and the inner ones those of its halves. */
export const surfaceOf = ({ face, hemisphere }: Pick<Disc, "face" | "hemisphere">): SurfaceName =>
  face === "inner" ? hemisphere : "whole";

export const surfacesOnMap = ({ has_inner }: Pick<MapView, "has_inner">): readonly SurfaceName[] =>
  has_inner ? ["whole", ...HEMISPHERES] : ["whole"];

/** Width and height of a map, in radii of the sphere. */
export const mapExtent = ({ has_inner }: Pick<MapView, "has_inner">): Vec2 => [2 * CELL, (has_inner ? 2 : 1) * CELL];

/** The discs of a map, row by row, left on the left. */
export function discsOf(centres: Centres, { normal }: MirrorPlane, hasInner: boolean): readonly Disc[] {
  const faces: readonly MapFace[] = hasInner ? ["outer", "inner"] : ["outer"];
  const extent = mapExtent({ has_inner: hasInner });
  const upright = normalized(subtract([0, 0, 1], scale(normal, normal[2])));
  return faces.flatMap((face, row) =>
    HEMISPHERES.map((hemisphere, column): Disc => {
      const outwards = scale(normal, hemisphere === "left" ? 1 : -1);
      const towards = face === "outer" ? outwards : scale(outwards, -1);
      return {
        hemisphere,
        face,
        center_in_patient: centres[hemisphere],
        axes: [cross(upright, towards), upright, towards],
        offset: [CELL * (column + 0.5) - extent[0] / 2, extent[1] / 2 - CELL * (row + 0.5)],
        extent,
      };
    }),
  );
}

/** How many pixels the radius of the sphere has in a pane. */
export const pixelsPerUnit = (extent: Vec2, { zoom }: Pick<MapView, "zoom">, size: Vec2): number =>
  zoom * Math.min(size[0] / extent[0], size[1] / extent[1]);

/** The projection of a disc into a pane of so many pixels, which count from its top left corner. */
export interface DiscProjection {
  readonly disc: Disc;
  readonly center: Vec2;
  readonly pixels_per_unit: number;
  /** The direction to the viewer at a place; null beyond the margin. */
  directionAt(place: Vec2): Vec3 | null;
  /** Where a position lies; null beyond the margin. */
  placeOf(position_in_patient: Vec3): Vec2 | null;
}

export function projectDisc(disc: Disc, view: MapView, size: Vec2): DiscProjection {
  const pixels_per_unit = pixelsPerUnit(disc.extent, view, size);
  const [right, up] = view.pan_mm.map((pan_mm) => pan_mm / MAP_RADIUS_MM) as [number, number];
  const center: Vec2 = [
    size[0] / 2 + (disc.offset[0] + right) * pixels_per_unit,
    size[1] / 2 - (disc.offset[1] + up) * pixels_per_unit,
  ];
  const [toRight, toTop, towards] = disc.axes;
  return {
    disc,
    center,
    pixels_per_unit,
    directionAt([x, y]) {
      const [a, b] = [(x - center[0]) / pixels_per_unit, (center[1] - y) / pixels_per_unit];
      const squared = a * a + b * b;
      if (squared > MAP_MARGIN * MAP_MARGIN) return null;
      const stretch = Math.sqrt(Math.max(1 - squared / 4, 0));
      return add(add(scale(toRight, a * stretch), scale(toTop, b * stretch)), scale(towards, 1 - squared / 2));
    },
    placeOf(position) {
      const direction = normalized(subtract(position, disc.center_in_patient));
      const along = dot(direction, towards);
      if (!(2 * (1 - along) <= MAP_MARGIN * MAP_MARGIN)) return null;
      const stretch = Math.sqrt(2 / (1 + along)) * pixels_per_unit;
      return [center[0] + dot(direction, toRight) * stretch, center[1] - dot(direction, toTop) * stretch];
    },
  };
}

/** How far a place is from the centre of a disc, in radii of the sphere. */
export const radiusAt = ({ center, pixels_per_unit }: DiscProjection, [x, y]: Vec2): number =>
  Math.hypot(x - center[0], y - center[1]) / pixels_per_unit;

export const discAt = (discs: readonly DiscProjection[], place: Vec2): DiscProjection | null =>
  discs.find((disc) => radiusAt(disc, place) <= MAP_MARGIN) ?? null;

/** Where a position lies on a map: on the discs of its own hemisphere, on that whose centre is nearest. */
export function placeOnMap(
  discs: readonly DiscProjection[],
  { normal, offset_mm }: MirrorPlane,
  position: Vec3,
): { readonly on: DiscProjection; readonly place: Vec2 } | null {
  const hemisphere = dot(normal, position) >= offset_mm ? "left" : "right";
  const places = discs.flatMap((on) => {
    const place = on.disc.hemisphere === hemisphere ? on.placeOf(position) : null;
    return place ? [{ on, place }] : [];
  });
  return places.sort((a, b) => radiusAt(a.on, a.place) - radiusAt(b.on, b.place))[0] ?? null;
}

/** The positions that a map shows, at every `step` pixels of its pane; NaN where it shows nothing. */
export interface MapPositions {
  readonly size: Vec2;
  readonly step: number;
  readonly xyz: Float32Array;
}

/** The position that is shown at a place. */
export function shownAt({ size, step, xyz }: MapPositions, [x, y]: Vec2): Vec3 | null {
  const [column, row] = [Math.floor(x / step), Math.floor(y / step)];
  if (column < 0 || row < 0 || column >= size[0] || row >= size[1]) return null;
  return pointOf(xyz, row * size[0] + column);
}

function pointOf(xyz: Float32Array, index: number): Vec3 | null {
  const [x = NaN, y = NaN, z = NaN] = xyz.subarray(3 * index, 3 * index + 3);
  return Number.isNaN(x) ? null : [x, y, z];
}

/** Where a coordinate changes by less than this share of the way, the surface lies along it: there, a level is noise and no curve. */
const ALONG = 0.15;

/** A step between neighbouring places that is longer than so many others lies across a fold. */
const FOLD = 4;

/** How many mm of the surface a pixel at a place is wide, as the side of a square of its area; null beside a fold. */
export function scaleAt(positions: MapPositions, [x, y]: Vec2): number | null {
  const { step } = positions;
  const at = (right: number, down: number): Vec3 | null => shownAt(positions, [x + right * step, y + down * step]);
  const [left, right, above, under] = [at(-1, 0), at(1, 0), at(0, -1), at(0, 1)];
  if (!left || !right || !above || !under) return null;
  const [across, down] = [subtract(right, left), subtract(under, above)];
  const area = length(cross(across, down)) / (2 * step) ** 2;
  const side = Math.sqrt(area);
  return Math.max(length(across), length(down)) > FOLD * 2 * step * side ? null : side;
}

/** The place that shows the point nearest to a position; null if that is farther than `most_mm`. */
export function nearestPlace({ size, step, xyz }: MapPositions, [x, y, z]: Vec3, most_mm: number): Vec2 | null {
  let [nearest, index] = [most_mm * most_mm, -1];
  for (let at = 0; at < size[0] * size[1]; at += 1) {
    const away =
      ((xyz[3 * at] ?? NaN) - x) ** 2 + ((xyz[3 * at + 1] ?? NaN) - y) ** 2 + ((xyz[3 * at + 2] ?? NaN) - z) ** 2;
    if (away < nearest) [nearest, index] = [away, at];
  }
  return index < 0 ? null : [((index % size[0]) + 0.5) * step, (Math.floor(index / size[0]) + 0.5) * step];
}

/** The whole multiples of `every` from one value up to another. */
export function multiples(every: number): (low: number, high: number) => readonly number[] {
  return (low, high) => {
    const first = Math.ceil(low / every);
    return first * every < high ? [first * every] : [];
  };
}

/** One level alone, if it lies from one value up to another. */
export const single =
  (level: number) =>
  (low: number, high: number): readonly number[] =>
    low <= level && level < high ? [level] : [];

/**
 * The curves on a map along which a coordinate of the position has one of some levels: pieces of lines, each from x, y to x, y in
 * pixels. `levels` gives those from a value up to another. Folds interrupt the curves, and places where the surface lies along a level.
 */
export function curvesOf(
  { size, step, xyz }: MapPositions,
  axis: 0 | 1 | 2,
  levels: (low: number, high: number) => readonly number[],
  isWithin: (place: Vec2) => boolean = () => true,
): readonly (readonly [number, number, number, number])[] {
  const typical = typicalStep(size, xyz);
  const [least, longest] = [ALONG * typical, FOLD * typical];
  const pieces: (readonly [number, number, number, number])[] = [];
  const corner = [0, 0, 0, 0];
  for (let row = 0; row + 1 < size[1]; row += 1) {
    for (let column = 0; column + 1 < size[0]; column += 1) {
      const first = 3 * (row * size[0] + column);
      const indices = [first, first + 3, first + 3 + 3 * size[0], first + 3 * size[0]];
      for (let at = 0; at < 4; at += 1) corner[at] = xyz[(indices[at] ?? 0) + axis] ?? NaN;
      const [low, high] = [Math.min(...corner), Math.max(...corner)];
      if (!(high - low > least) || high - low > longest) continue;
      for (const level of levels(low, high)) {
        const place: Vec2 = [(column + 1) * step, (row + 1) * step];
        if (!isWithin(place)) continue;
        const ends = crossings(corner, level).map(([right, down]): Vec2 => [
          (column + 0.5 + right) * step,
          (row + 0.5 + down) * step,
        ]);
        for (let end = 0; end + 1 < ends.length; end += 2) {
          const [from, to] = [ends[end], ends[end + 1]];
          if (from && to) pieces.push([...from, ...to]);
        }
      }
    }
  }
  return pieces;
}

/** The corners of a square, in order around it. */
const AROUND = [
  [0, 0],
  [1, 0],
  [1, 1],
  [0, 1],
] as const;

/** Where a level crosses the sides of a unit square with these values at its corners. */
function crossings(values: readonly number[], level: number): Vec2[] {
  const found: Vec2[] = [];
  for (let side = 0; side < 4; side += 1) {
    const [a = 0, b = 0] = [values[side], values[(side + 1) % 4]];
    if (a < level === b < level) continue;
    const share = (level - a) / (b - a);
    const [[x, y], [otherX, otherY]] = [AROUND[side] ?? AROUND[0], AROUND[(side + 1) % 4] ?? AROUND[0]];
    found.push([x + share * (otherX - x), y + share * (otherY - y)]);
  }
  return found;
}

/** The middle one of the steps between neighbouring positions, of a sample of them. */
function typicalStep(size: Vec2, xyz: Float32Array): number {
  const steps: number[] = [];
  const count = size[0] * size[1];
  const stride = Math.max(1, Math.floor(count / 2000));
  for (let index = 0; index + 1 < count; index += stride) {
    const [here, there] = [pointOf(xyz, index), pointOf(xyz, index + 1)];
    if (here && there) steps.push(distance(there, here));
  }
  return steps.sort((a, b) => a - b)[steps.length >> 1] ?? 0;
}
