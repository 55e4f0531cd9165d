// Which rows of a long list are in sight: pure.

import { clamp } from "./space.ts";

/** The height of a row with the gap below it, in CSS pixels, as in the style sheet. */
export const ROW_PIXELS = 56;
/** Rows beyond either edge that are there already when they come in sight. */
const BEYOND = 6;

/** From the first to before the last row that is to be there, of `count`. */
export function rowsInSight(count: number, scrolled: number, height: number): readonly [number, number] {
  const first = Math.floor(scrolled / ROW_PIXELS) - BEYOND;
  const end = Math.ceil((scrolled + height) / ROW_PIXELS) + BEYOND;
  const within = (row: number): number => clamp(row, 0, count);
  return [within(first), within(end)];
}

/** Rows that are seen by less than this are no targets: the least height of one, in CSS pixels (WCAG 2.2, 2.5.8). */
const LEAST_SEEN = 24;
const GAP_PIXELS = 4;

/**
 * Whether the open row, which stays at the edge that it has left by, covers a row so far that the rest of it is too narrow to be hit.
 */
export function isCovered(row: number, open: number, scrolled: number, height: number): boolean {
  const tall = ROW_PIXELS - GAP_PIXELS;
  const own = open * ROW_PIXELS;
  const at = clamp(own, scrolled, scrolled + height - tall);
  const top = row * ROW_PIXELS;
  if (open < 0 || row === open || at === own || top + tall <= at || top >= at + tall) return false;
  return (at < own ? at - top : top + tall - (at + tall)) < LEAST_SEEN;
}

/**
 * Where a list is scrolled to so that a row is in sight, beside the open one (-1: none), which stays at the edge it has left by;
 * as it is, where it is already.
 */
export function scrolledTo(row: number, open: number, scrolled: number, height: number): number {
  const top = (row - Number(open >= 0 && open < row)) * ROW_PIXELS;
  const bottom = (row + 1 + Number(open > row)) * ROW_PIXELS;
  if (top < scrolled) return top;
  return Math.max(scrolled, bottom - height);
}
