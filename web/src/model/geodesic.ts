// Lengths and areas along an isosurface of the depth: pure.

import { type Depths, below, firstHit } from "./isosurface.ts";
import { type Vec3, add, cross, dot, length, normalized, scale, subtract, meanOf, distance } from "./space.ts";

/** An isosurface around a point from which all of it is seen. */
export interface Isosurface {
  readonly depths: Depths;
  readonly depth_mm: number;
  readonly center: Vec3;
}

/** How near to the surface a point is put, in mm. */
const TOLERANCE_MM = 0.002;
/** The parts of the finest curve are at most so long, in mm, but there are no more than so many. */
const PART_MM = 2;
const MOST_PARTS = 256;
/** A curve is shortened until no point moves by more than this share of a part, at most so often. */
const RESTS = 1e-3;
const MOST_ROUNDS = 60;
/** A triangle of a polygon is divided until its edges are at most this long, in mm. */
const EDGE_MM = 3;
const MOST_DIVISIONS = 6;

/** The nearest point of the surface, up or down the gradient. */
export function settled({ depths, depth_mm }: Isosurface, position: Vec3): Vec3 {
  let here = position;
  for (let round = 0; round < 20; round += 1) {
    const under = below(depths, here, depth_mm);
    if (!(Math.abs(under) > TOLERANCE_MM)) break;
    here = add(here, scale(depths.inwardAt(here), -under));
  }
  return here;
}

/** The point of the surface in a direction from its middle. */
function outAt({ depths, depth_mm, center }: Isosurface, direction: Vec3, reach_mm: number): Vec3 {
  const from = add(center, scale(direction, reach_mm));
  return firstHit(depths, { from, direction: scale(direction, -1), reach_mm }, depth_mm) ?? center;
}

const middleOfTwo = (a: Vec3, b: Vec3): Vec3 => scale(add(a, b), 0.5);

/** The point of the surface half-way between two of its points, seen from its middle. */
function between(surface: Isosurface, a: Vec3, b: Vec3): Vec3 {
  const [one, other] = [subtract(a, surface.center), subtract(b, surface.center)];
  const sum = add(normalized(one), normalized(other));
  // Opposite points have no direction between them: any will do.
  const across = Math.abs(one[2]) < 0.9 * length(one) ? cross(one, [0, 0, 1]) : cross(one, [1, 0, 0]);
  const direction = normalized(length(sum) > 1e-3 ? sum : across);
  return outAt(surface, direction, 2 * Math.max(length(one), length(other)) + 20);
}

/** The shortest curve along the surface from one of its points to another, as far as is known: no loop is shorter nearby. */
export function geodesic(surface: Isosurface, a: Vec3, b: Vec3): readonly Vec3[] {
  const ends = [settled(surface, a), settled(surface, b)] as const;
  let curve: Vec3[] = [...ends];
  for (;;) {
    const part = lengthOf(curve) / (curve.length - 1);
    if (curve.length > 8 && (part <= PART_MM || curve.length > MOST_PARTS)) return curve;
    // Of points that are far apart the chord runs through the middle of the head.
    const isCoarse = curve.length < 8;
    curve = curve.flatMap((point, at) => {
      const next = curve[at + 1];
      if (!next) return [point];
      return [point, isCoarse ? between(surface, point, next) : settled(surface, middleOfTwo(point, next))];
    });
    // The middle of two points that are far apart is nowhere near the surface.
    if (curve.length > 8) shorten(surface, curve);
    if (part === 0) return curve;
  }
}

/** Pulls a curve tight: each point goes half-way between its neighbours, and back to the surface. */
function shorten(surface: Isosurface, curve: Vec3[]): void {
  for (let round = 0; round < MOST_ROUNDS; round += 1) {
    const rest = (RESTS * lengthOf(curve)) / curve.length;
    let most = 0;
    for (let at = 1; at < curve.length - 1; at += 1) {
      const [before, here, after] = [curve[at - 1], curve[at], curve[at + 1]];
      if (!before || !here || !after) continue;
      const next = settled(surface, middleOfTwo(before, after));
      most = Math.max(most, distance(next, here));
      curve[at] = next;
    }
    if (most <= rest) return;
  }
}

/** The length of a line through points, in mm; `isClosed`: back to the first. */
export function lengthOf(points: readonly Vec3[], isClosed = false): number {
  const last = isClosed ? points.length : points.length - 1;
  let sum = 0;
  for (let at = 0; at < last; at += 1) {
    const [from, to] = [points[at], points[(at + 1) % points.length]];
    if (from && to) sum += distance(to, from);
  }
  return sum;
}

/** The area of a closed line as a vector across it: half the sum of the cross products about its middle. */
export function areaVector(points: readonly Vec3[]): Vec3 {
  const middle = meanOf(points);
  return points.reduce<Vec3>(
    (sum, point, at) => {
      const next = points[(at + 1) % points.length] ?? point;
      return add(sum, scale(cross(subtract(point, middle), subtract(next, middle)), 0.5));
    },
    [0, 0, 0],
  );
}

/** The area of the part of the surface within a closed line of its points, in mm². */
export function areaWithin(surface: Isosurface, points: readonly Vec3[]): number {
  const up = normalized(areaVector(points));
  const middle = settled(surface, meanOf(points));
  const corners = points.map((point) => settled(surface, point));
  let sum = 0;
  for (const [at, corner] of corners.entries()) {
    const next = corners[(at + 1) % corners.length] ?? corner;
    // A triangle that lies outside of the line is taken off.
    const turn = dot(cross(subtract(corner, middle), subtract(next, middle)), up);
    sum += Math.sign(turn) * divided(surface, [middle, corner, next], MOST_DIVISIONS);
  }
  return Math.abs(sum);
}

/** The area of a triangle of points of the surface, divided until it lies close to it. */
function divided(surface: Isosurface, [a, b, c]: readonly [Vec3, Vec3, Vec3], left: number): number {
  const longest = Math.max(distance(a, b), distance(b, c), distance(c, a));
  if (left === 0 || longest <= EDGE_MM) return length(cross(subtract(b, a), subtract(c, a))) / 2;
  const [ab, bc, ca] = [middleOfTwo(a, b), middleOfTwo(b, c), middleOfTwo(c, a)].map((point) =>
    settled(surface, point),
  ) as [Vec3, Vec3, Vec3];
  return (
    divided(surface, [a, ab, ca], left - 1) +
    divided(surface, [ab, b, bc], left - 1) +
    divided(surface, [ca, bc, c], left - 1) +
    divided(surface, [ab, bc, ca], left - 1)
  );
}

/** Whether a closed line of points crosses itself, seen across it. */
export function crossesItself(points: readonly Vec3[]): boolean {
  const count = points.length;
  if (count < 4) return false;
  const across = areaVector(points);
  const up = length(across) > 1e-9 ? normalized(across) : normalOf(points);
  const right = normalized(subtract(points[1] as Vec3, points[0] as Vec3));
  const down = cross(up, right);
  const flat = points.map((point) => [dot(point, right), dot(point, down)] as const);
  const side = (a: number, b: number, c: number): number => {
    const [[ax, ay], [bx, by], [cx, cy]] = [flat[a], flat[b], flat[c]] as [
      readonly [number, number],
      readonly [number, number],
      readonly [number, number],
    ];
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  };
  for (let one = 0; one < count; one += 1)
    for (let other = one + 2; other < count; other += 1) {
      const [next, after] = [one + 1, (other + 1) % count];
      if (after === one) continue;
      if (side(one, next, other) * side(one, next, after) < 0 && side(other, after, one) * side(other, after, next) < 0)
        return true;
    }
  return false;
}

/** Across the first three points that are not in a line: of a figure of eight the areas cancel. */
function normalOf(points: readonly Vec3[]): Vec3 {
  const [first, second] = points as readonly [Vec3, Vec3];
  for (const point of points.slice(2)) {
    const across = cross(subtract(second, first), subtract(point, first));
    if (length(across) > 1e-9) return normalized(across);
  }
  return [0, 0, 1];
}
