// What a reader measures in the pictures: pure.

import { slidTo } from "./flow.ts";
import { areaVector, areaWithin, crossesItself, geodesic, lengthOf, type Isosurface } from "./geodesic.ts";
import { type Vec3, clamp, dot, length, normalized, subtract } from "./space.ts";

/** The tools of the ruler: a straight length, a line of several parts, an angle, an area, a way to a target, both commissures. */
export const TOOLS = ["length", "line", "angle", "area", "trajectory", "acpc"] as const;
export type Tool = (typeof TOOLS)[number];

/** How many points a measure has: it is complete with the most. */
export const POINTS: Readonly<Record<Tool, readonly [number, number]>> = {
  length: [2, 2],
  line: [2, Infinity],
  angle: [3, 3],
  area: [3, Infinity],
  trajectory: [2, 2],
  acpc: [2, 2],
};

/** Whether it goes straight through the head, whatever surface its points were set on. */
export const isWay = (tool: string): tool is "trajectory" | "acpc" => tool === "trajectory" || tool === "acpc";

/** Whether commissures may lie so far apart: the server refuses others. */
export const areCommissures = (apart_mm: number): boolean => apart_mm >= 10 && apart_mm <= 45;

/** Where a point was set: in a slice, or on the surface at the depth that was shown. */
export type Where = "slice" | "surface";

export interface Measure {
  readonly id: string;
  readonly tool: Tool;
  readonly points_in_patient: readonly Vec3[];
  /** Where all of its points were set; a measure of points of both is straight. */
  readonly where: Where | "both";
  /** The depth of the surface that it was set on, or that was shown beside its slice. */
  readonly depth_mm: number;
}

/** What a measure says; what it does not have is absent. */
export interface Values {
  /** Straight from point to point. */
  readonly straight_mm?: number;
  /** Along the surface from point to point. */
  readonly along_mm?: number;
  readonly angle_deg?: number;
  readonly area_mm2?: number;
  /** The line of an area crosses itself, so that it has none. */
  readonly isCrossed?: boolean;
  readonly drawn: readonly Vec3[];
}

/** The angle at the second of three points; NaN where two of them are the same. */
function angleAt([one, corner, other]: readonly Vec3[]): number {
  if (!one || !corner || !other) return NaN;
  const [to, from] = [subtract(one, corner), subtract(other, corner)];
  if (length(to) === 0 || length(from) === 0) return NaN;
  return (Math.acos(clamp(dot(normalized(to), normalized(from)), -1, 1)) * 180) / Math.PI;
}

/** The curves along the surface from point to point as one line. */
function along(surface: Isosurface, points: readonly Vec3[], isClosed: boolean): readonly Vec3[] {
  const ends = isClosed ? [...points, ...points.slice(0, 1)] : points;
  return ends.flatMap((point, at) => {
    const before = ends[at - 1];
    if (!before) return [];
    const curve = geodesic(surface, before, point);
    return at === 1 ? curve : curve.slice(1);
  });
}

/** The values of a measure; without a surface that is known, those of straight lines alone. */
export function valuesOf({ tool, where, points_in_patient: points }: Measure, surface: Isosurface | null): Values {
  if (tool === "angle") return { angle_deg: angleAt(points), drawn: points };
  const isArea = tool === "area";
  const straight_mm = lengthOf(points, isArea);
  const isAlong = where === "surface" && !isWay(tool) && surface !== null;
  const curve = isAlong ? along(surface, points, isArea) : null;
  const lengths = { straight_mm, ...(curve && { along_mm: lengthOf(curve) }), drawn: curve ?? points };
  if (!isArea || points.length < 3) return lengths;
  if (crossesItself(points)) return { ...lengths, isCrossed: true };
  const area_mm2 = isAlong ? areaWithin(surface, points) : length(areaVector(points));
  return { ...lengths, area_mm2 };
}

/** The depths between which the column below an area is measured, in mm. */
export type Column = readonly [from_mm: number, to_mm: number];

/** Areas of a column are computed at depths so far apart, at most, in mm. */
const AREAS_MM = 2;
/** A point that comes no nearer to a depth than this has not come to it, in mm. */
const REACHED_MM = 0.3;

/**
 * The volume of the column below an area on the surface, between two depths, in mm³: its line goes along the flow from
 * depth to depth, and what lies within is summed by Simpson's rule, for the depth grows by 1 mm in 1 mm. NaN if the flow
 * does not lead so far, because it ends at a ridge or in the middle.
 */
export function columnOf(
  { points_in_patient }: Measure,
  surface: Omit<Isosurface, "depth_mm">,
  [from_mm, to_mm]: Column,
): number {
  const span_mm = to_mm - from_mm;
  if (!(span_mm > 0)) return span_mm === 0 ? 0 : NaN;
  const { depths } = surface;
  const parts = 2 * Math.ceil(span_mm / 2 / AREAS_MM);
  const step_mm = span_mm / parts;
  let points = points_in_patient;
  let sum = 0;
  for (let at = 0; at <= parts; at += 1) {
    const depth_mm = from_mm + at * step_mm;
    // From one depth to the next, so that no way is walked twice.
    points = points.map((point) => slidTo(depths, point, depth_mm));
    if (points.some((point) => !(Math.abs(depths.depthAt(point) - depth_mm) < REACHED_MM))) return NaN;
    const weight = at === 0 || at === parts ? 1 : at % 2 === 1 ? 4 : 2;
    sum += weight * areaWithin({ ...surface, depth_mm }, points);
  }
  return (sum * step_mm) / 3;
}
