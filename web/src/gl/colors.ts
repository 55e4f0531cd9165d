// The colours of each brightness, as the server has them: its tables come with the shaders.

import { COLORMAPS, type Colormap } from "../model/state.ts";

/** The row of a colour map in the table. */
export const colorRow = (name: Colormap): number => COLORMAPS.indexOf(name);

/** A row of 256 colours for each map: red, green, blue and 255. */
export function colorTable(tables: Readonly<Record<Colormap, string>>): Uint8Array<ArrayBuffer> {
  const table = new Uint8Array(1024 * COLORMAPS.length).fill(255);
  for (const [row, name] of COLORMAPS.entries()) {
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
