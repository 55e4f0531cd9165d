// The colours of each brightness, as the server has them: its tables come with the shaders.

import { COLORMAPS } from "../model/state.ts";

/** The maps in the rows of the table: those of intensities, then those of overlays. */
export const COLOR_NAMES = [...COLORMAPS, "vermilion-yellow", "blue-orange", "labels"] as const;
export type ColorName = (typeof COLOR_NAMES)[number];

/** The row of a colour map in the table. */
export const colorRow = (name: ColorName): number => COLOR_NAMES.indexOf(name);

/** A row of 256 colours for each map: red, green, blue and 255. */
export function colorTable(tables: Readonly<Record<ColorName, string>>): Uint8Array<ArrayBuffer> {
  const table = new Uint8Array(1024 * COLOR_NAMES.length).fill(255);
  for (const [row, name] of COLOR_NAMES.entries()) {
    // All of red, then green, then blue, each as the difference from the one before.
    const differences = (tables[name].match(/../g) ?? []).map((digits) => Number.parseInt(digits, 16));
    let share = 0;
    for (const [place, difference] of differences.entries()) {
      share = (share + difference) & 255;
      table[1024 * row + 4 * (place % 256) + Math.floor(place / 256)] = share;
    }
  }
  return table;
}
