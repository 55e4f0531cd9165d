// What is asked of the server for many pictures in one file: pure.

import type { ViewName } from "./camera.ts";
import { renderQuery } from "./query.ts";
import { type Vec2, clamp } from "./space.ts";
import type { ViewState } from "./state.ts";
import type { SweepChoice } from "./sweep.ts";

/** The most pictures in one file. */
export const MOST_PICTURES = 256;

type Json = string | number | boolean | readonly Json[] | { readonly [key: string]: Json };

/** A picture of a state, with what stands on it, as the server's interface takes it in JSON. */
export function pictureBody(state: ViewState, size: Vec2): Record<string, Json> {
  // What is saved need not be drawn as fast as what moves.
  const query = renderQuery({ ...state, way: state.way === "auto" ? "exact" : state.way }, size);
  const lists = ["orientation", "pan", "window", "overlay_window"];
  const words = ["surface", "view", "colormap", "layer", "overlay", "overlay_colormap", "renderer"];
  const entries = [...query].map(([key, text]): [string, Json] => {
    if (lists.includes(key)) return [key, text.split(",").map(Number)];
    return [key, words.includes(key) ? text : Number(text)];
  });
  return { ...Object.fromEntries(entries), annotate: true };
}

const without = (body: Record<string, Json>, ...keys: string[]): Record<string, Json> =>
  Object.fromEntries(Object.entries(body).filter(([key]) => !keys.includes(key)));

/** A contact sheet: a row for each depth, a column for each direction, all centred. */
export function sheetBody(
  state: ViewState,
  depths_mm: readonly number[],
  views: readonly ViewName[],
  side: number,
): Json {
  const renders = depths_mm.flatMap((depth_mm) =>
    views.map((view) => ({
      ...without(pictureBody({ ...state, depth_mm, zoom: 1, pan_mm: [0, 0] }, [side, side]), "orientation"),
      view,
    })),
  );
  return { renders, sheet: true };
}

/** A full turn of what a state shows. */
export const turnBody = (state: ViewState, frames: number, delay_ms: number, size: Vec2): Json => ({
  swivel: { frames, delay_ms, render: pictureBody(state, size) },
});

/** A sweep through the depths, a step of `step_mm` to each picture. */
export function sweepBody(state: ViewState, choice: SweepChoice, step_mm: number, size: Vec2): Json {
  const { from_mm, to_mm, mm_per_s, turns } = choice;
  const most = turns ? MOST_PICTURES / 2 : MOST_PICTURES;
  const frames = clamp(Math.round((to_mm - from_mm) / step_mm) + 1, 2, most);
  const delay_ms = clamp(Math.round((1000 * (to_mm - from_mm)) / (frames - 1) / mm_per_s), 10, 10_000);
  const render = without(pictureBody(state, size), "depth_mm", "slab_mm");
  const slab = state.slab_mm > 0 ? { slab_mm: state.slab_mm } : {};
  const pictures = { from_mm, to_mm, frames, delay_ms, there_and_back: turns, average_shallow: state.averages_shallow };
  return { sweep: { ...pictures, render: { ...render, ...slab } } };
}
