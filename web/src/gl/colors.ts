// The colours of each brightness, as the server has them.

import tables from "../../shaders/colors.json";
import type { Colormap } from "../model/state.ts";

const NAMES = Object.keys(tables) as Colormap[];

/** The row of a colour map in the table. */
export const colorRow = (name: Colormap): number => NAMES.indexOf(name);

/** A row of 256 colours for each map: red, green, blue and 255. */
export const COLOR_TABLE: Uint8Array<ArrayBuffer> = new Uint8Array(1024 * NAMES.length).fill(255);

for (const [row, name] of NAMES.entries()) {
  // All of red, then green, then blue, each as the difference from the one before.
  const differences = (tables[name].match(/../g) ?? []).map((digits) => Number.parseInt(digits, 16));
  let share = 0;
  for (const [place, difference] of differences.entries()) {
    share = (share + difference) & 255;
    COLOR_TABLE[1024 * row + 4 * (place % 256) + Math.floor(place / 256)] = share;
  }
}
