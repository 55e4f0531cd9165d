// What is marked in a head, and where it is in a picture: pure.

import type { Projection } from "./camera.ts";
import { type Vec2, type Vec3, add, clamp, scale, subtract } from "./space.ts";

/** Something that a reader has marked or measured. */
export interface Marked {
  /** What stands beside it. */
  readonly words: string;
  readonly points_in_patient: readonly Vec3[];
  readonly isClosed: boolean;
  readonly colour: string;
  /** The depth at which it was marked; null where it has none of its own, such as a way through several. */
  readonly depth_mm: number | null;
  /** Whether it is shown on the surface as well. */
  readonly isOnSurface: boolean;
  /** It does not lie on the surface of its depth: there it is drawn dashed, at every depth. */
  readonly isOff?: boolean;
  /** Its words are a value of all of it: they stand where all of it is seen. */
  readonly isValue?: boolean;
  /** Its points on the surface at a depth. */
  pointsAt(depth_mm: number): readonly Vec3[];
}

/** Places of a line in a pane; a single one is a point. */
export type Line = readonly Vec2[];

/** The same at places of a pane. */
export interface Mark {
  readonly words: string;
  /** Its parts that are to be seen; a part of one place is a point. */
  readonly parts: readonly Line[];
  readonly colour: string;
  /** It was marked at another depth than the one that is shown, or beside the slice. */
  readonly isAway: boolean;
}

/** What is judged lies free: so much around a marked place has no line, in mm, but at least so much, in CSS pixels. */
const FREE_MM = 5;
const LEAST_FREE = 6;

/** The radius around a marked place that is free, in CSS pixels; in a pane of this size its marks are to be seen all the same. */
export const freeOf = (mm_per_pixel: number, size: Vec2): number =>
  clamp(FREE_MM / mm_per_pixel, LEAST_FREE, Math.max(Math.min(...size) / 2 - 16, LEAST_FREE));

/** A mark of another depth than the one that is shown by more than this is drawn dashed, in mm. */
const AWAY_MM = 1;
/** A slice shows what lies so near to it, in mm; dashed, what does not lie in it. */
const NEAR_MM = 4;
/** Places of a line that are nearer than this to the one before are not drawn, in CSS pixels. */
const NEXT = 1.5;
/** Long paths are drawn in pieces of so many places: their time grows faster than their length. */
const PIECE = 100;

const closed = <T>(points: readonly T[], isClosed: boolean): readonly T[] =>
  isClosed ? [...points, ...points.slice(0, 1)] : points;

/** The marks on the half of the head that faces the viewer. */
export function surfaceMarks(
  all: readonly Marked[],
  depth_mm: number,
  { pixelOf }: Pick<Projection, "pixelOf">,
): readonly Mark[] {
  return all.flatMap((marked) => {
    if (!marked.isOnSurface) return [];
    const parts: Vec2[][] = [[]];
    for (const point of closed(marked.pointsAt(depth_mm), marked.isClosed)) {
      const [x, y, height_mm] = pixelOf(point);
      if (height_mm >= 0 && Number.isFinite(x + y)) parts.at(-1)?.push([x, y]);
      else if (parts.at(-1)?.length !== 0) parts.push([]);
    }
    const isAtOther = marked.depth_mm !== null && Math.abs(marked.depth_mm - depth_mm) > AWAY_MM;
    return markOf(marked, parts, isAtOther || marked.isOff === true);
  });
}

/** Whether all points lie in one slice in the planes of the patient, within 1 mm. */
const isFlat = (points: readonly Vec3[]): boolean =>
  [0, 1, 2].some((axis) => {
    const along = points.map((point) => point[axis] ?? NaN);
    return Math.max(...along) - Math.min(...along) <= AWAY_MM;
  });

/**
 * The marks in a slice, `away` being how far a point lies from it: of lines, what lies near to it. A line that lies in one slice
 * is in its plane alone, or beside it dashed; across it nothing was marked.
 */
export function sliceMarks(
  all: readonly Marked[],
  away: (point: Vec3) => number,
  pixelOf: (point: Vec3) => Vec2,
): readonly Mark[] {
  return all.flatMap((marked) => {
    const points = closed(marked.points_in_patient, marked.isClosed);
    const aways = points.map(away);
    // Most of thousands lie in other slices.
    if (aways.every((one) => one > NEAR_MM) || aways.every((one) => one < -NEAR_MM)) return [];
    const isWhole = aways.every((one) => Math.abs(one) <= NEAR_MM);
    if (!isWhole && isFlat(points)) return [];
    const lines = points.length === 1 ? points.map((point) => [point, point] as const) : pairs(points);
    const near = lines.map(([from, to]) => cutOff(from, to, away(from), away(to))).filter((one) => one !== null);
    const parts: Vec3[][] = [];
    for (const [from, to] of near) {
      if (parts.at(-1)?.at(-1) === from) parts.at(-1)?.push(to);
      else parts.push(from === to ? [from] : [from, to]);
    }
    const crosses = lines.some(([from, to]) => away(from) * away(to) <= 0);
    const isAway = !crosses && !points.some((point) => Math.abs(away(point)) <= AWAY_MM);
    return markOf(
      isWhole || !marked.isValue ? marked : { ...marked, words: "" },
      parts.map((part) => part.map(pixelOf)),
      isAway,
    );
  });
}

function markOf({ words, colour }: Marked, parts: readonly (readonly Vec2[])[], isAway: boolean): readonly Mark[] {
  const seen = parts.filter((part) => part.length > 0);
  return seen.length > 0 ? [{ words, parts: seen, colour, isAway }] : [];
}

const pairs = (points: readonly Vec3[]): readonly (readonly [Vec3, Vec3])[] =>
  points.slice(1).map((point, at) => [points[at] ?? point, point] as const);

/** The part of a line that is near the slice; `a` and `b` are how far its ends are from it. */
function cutOff(from: Vec3, to: Vec3, a: number, b: number): readonly [Vec3, Vec3] | null {
  if (Math.min(Math.abs(a), Math.abs(b)) > NEAR_MM && a * b > 0) return null;
  if (from === to) return [from, to];
  const at = (away: number): Vec3 => add(from, scale(subtract(to, from), (away - a) / (b - a)));
  const end = (point: Vec3, away: number): Vec3 => (Math.abs(away) <= NEAR_MM ? point : at(Math.sign(away) * NEAR_MM));
  return [end(from, a), end(to, b)];
}

/** A line without the places that are too near to the one before to be told from it. */
export function thinned(line: Line): Line {
  let last: Vec2 = [Infinity, Infinity];
  return line.filter((place, at) => {
    const isKept = at === line.length - 1 || Math.abs(place[0] - last[0]) + Math.abs(place[1] - last[1]) >= NEXT;
    if (isKept) last = place;
    return isKept;
  });
}

/** Lines in groups of about `PIECE` places; longer ones are cut, and both parts have the place of the cut. */
export function pieces(lines: readonly Line[]): readonly (readonly Line[])[] {
  const all: Line[][] = [];
  let room = 0;
  for (const line of lines) {
    for (let from = 0; from === 0 || from < line.length - 1; from += PIECE) {
      const part = line.slice(from, from + PIECE + 1);
      if (room < part.length) {
        all.push([]);
        room = PIECE + 1;
      }
      all.at(-1)?.push(part);
      room -= part.length;
    }
  }
  return all;
}

/** The words of a mark, where their baseline begins, and what they cover. */
export interface Lettering {
  readonly mark: Mark;
  readonly at: Vec2;
  readonly box: Box;
  readonly hair?: Line;
}

/** The length of the line from a point to its number, which begins where the point is free no more, in CSS pixels. */
const HAIR = 24;
/** Its directions, the best first. */
const HAIR_WAYS: readonly Vec2[] = [
  [1, -1],
  [1, 1],
  [-1, -1],
  [-1, 1],
];

/** The line of a point to its number; those that find no room are longer. */
export function hairOf([x, y]: Vec2, free: number, [across, down]: Vec2 = [1, -1], length = HAIR): Line {
  const at = (away: number): Vec2 => [x + across * away * Math.SQRT1_2, y + down * away * Math.SQRT1_2];
  return [at(free), at(free + length)];
}

export const ringOf = ([x, y]: Vec2, radius: number): Line =>
  Array.from({ length: RING_PARTS + 1 }, (_, at) => {
    const turn = (2 * Math.PI * at) / RING_PARTS;
    return [x + radius * Math.cos(turn), y + radius * Math.sin(turn)];
  });
const RING_PARTS = 32;

/**
 * The part of a pane that marks and their words cover, `reach` being how far a line reaches from its places. Its borders
 * are multiples of `step`, or those of the pane, so that it seldom changes while the head is turned.
 */
export function covered(
  lines: readonly Line[],
  letters: readonly Pick<Lettering, "box">[],
  { pane: [width, height], reach, step }: { readonly pane: Vec2; readonly reach: number; readonly step: number },
): Box {
  let [left, top, right, bottom] = [Infinity, Infinity, -Infinity, -Infinity];
  const cover = (box: Box): void => {
    [left, top] = [Math.min(left, box[0]), Math.min(top, box[1])];
    [right, bottom] = [Math.max(right, box[2]), Math.max(bottom, box[3])];
  };
  for (const line of lines) for (const [x, y] of line) cover([x, y, x, y]);
  cover([left - reach, top - reach, right + reach, bottom + reach]);
  for (const { box } of letters) cover([box[0] - FREE, box[1] - FREE, box[2] + FREE, box[3] + FREE]);
  const before = (place: number, side: number): number => clamp(Math.floor(place / step) * step, 0, side);
  const after = (place: number, side: number): number => clamp(Math.ceil(place / step) * step, 0, side);
  return [before(left, width), before(top, height), after(right, width), after(bottom, height)];
}

/** Words stand so far beside the first place of their mark, and above it, in CSS pixels. */
const BESIDE: Vec2 = [10, 7];
/** How far words reach above their baseline and below it, and how far they stay from others, in CSS pixels. */
const ASCENT = 11;
const DESCENT = 3;
const FREE = 3;
/** Words that find no room beside their mark may stand some lines above or below it, in CSS pixels. */
const AWAY_LINES = [0, 1, 2, 3].map((line) => line * (ASCENT + DESCENT));

type Placed = Pick<Lettering, "at" | "hair">;

/**
 * The words of marks in a pane, none over others: two numbers that run into one another would read as a third one. What
 * finds no room is left out. Of the marks that begin in one cell of this size, if there are cells, the first has words.
 */
export function lettered(
  marks: readonly Mark[],
  pane: Vec2,
  widthOf: (words: string) => number,
  { free = LEAST_FREE, cell = null }: { readonly free?: number; readonly cell?: Vec2 | null } = {},
): readonly Lettering[] {
  const cells = new Set<string>();
  const taken: Box[] = [];
  return marks.flatMap((mark) => {
    const { words, parts } = mark;
    const [[x, y] = [0, 0], second] = parts[0] ?? [];
    const key = cell ? `${Math.floor(x / cell[0])} ${Math.floor(y / cell[1])}` : "";
    if (words === "" || (cell && cells.has(key))) return [];
    cells.add(key);
    const width = widthOf(words);
    const places = second ? placesBeside([x, y], width) : placesOnHair([x, y], width, free);
    const isFree = ({ at }: Placed): boolean => taken.every((box) => !meet(box, boxOf(at, width)));
    const isGood = (one: Placed): boolean => isWithin(boxOf(one.at, width), pane) && isFree(one);
    const place = places.find(isGood) ?? places.find(isFree);
    if (!place) return [];
    const box = boxOf(place.at, width);
    taken.push(box);
    return [{ mark, box, ...place }];
  });
}

/** Left, top, right and bottom. */
export type Box = readonly [number, number, number, number];

const boxOf = ([x, y]: Vec2, width: number): Box => [x, y - ASCENT, x + width, y + DESCENT];

const meet = (a: Box, b: Box): boolean => a[0] < b[2] + FREE && b[0] < a[2] + FREE && a[1] < b[3] && b[1] < a[3];

const isWithin = ([left, top, right, bottom]: Box, [width, height]: Vec2): boolean =>
  left >= 0 && top >= 0 && right <= width && bottom <= height;

/** Where words of a width may stand beside a place, the best first: to its right, above or below, else to its left. */
function placesBeside([x, y]: Vec2, width: number): readonly Placed[] {
  const [beside, above] = BESIDE;
  return AWAY_LINES.flatMap((away) =>
    [x + beside, x - beside - width].flatMap((left): Placed[] => [
      { at: [left, y - above - away] },
      { at: [left, y + above + ASCENT - DESCENT + away] },
    ]),
  );
}

/** Where the words of a point may stand: at the end of its line. */
const placesOnHair = (place: Vec2, width: number, free: number): readonly Placed[] =>
  AWAY_LINES.flatMap((away) =>
    HAIR_WAYS.map((way) => {
      const hair = hairOf(place, free, way, HAIR + 2 * away);
      const [x, y] = hair[1] ?? place;
      return { at: [way[0] > 0 ? x + FREE : x - FREE - width, y + (ASCENT - DESCENT) / 2], hair };
    }),
  );
