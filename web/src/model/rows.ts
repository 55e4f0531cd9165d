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

/** Where a list is scrolled to so that a row is in sight; as it is, where it is already. */
export function scrolledTo(row: number, scrolled: number, height: number): number {
  const top = row * ROW_PIXELS;
  return Math.min(top, Math.max(scrolled, top + ROW_PIXELS - height));
}
