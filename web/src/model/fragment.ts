// The state in the address: `#<case>&d=8.5&v=left`. What is as at first is left out; what is not understood is passed
// over.

import { NAMED_VIEWS, VIEW_NAMES, viewName } from "./camera.ts";
import type { ReadyCase, Window } from "./case.ts";
import { boundWindow } from "./controls.ts";
import { type Quat, type Vec2, type Vec3, unit } from "./space.ts";
import {
  COLORMAPS,
  LAYOUTS,
  PAN_LIMIT_MM,
  SLAB_LIMIT_MM,
  type ViewState,
  WAYS,
  ZOOM_RANGE,
  clamp,
  clampDepth,
  firstState,
} from "./state.ts";

/** What an address holds: a case, and its state in a form that only the case can read. */
export interface Address {
  readonly id: string | null;
  readonly rest: string;
}

export function readAddress(fragment: string): Address {
  const [first = "", ...rest] = fragment.replace(/^#/, "").split("&");
  return /^[0-9a-f]{32}$/.test(first) ? { id: first, rest: rest.join("&") } : { id: null, rest: "" };
}

const short = (value: number, digits: number): string => String(Number(value.toFixed(digits)));
const list = (values: readonly number[], digits: number): string =>
  values.map((value) => short(value, digits)).join(",");
/** To a ten-thousandth of the way from black to white: intensities may be of any size. */
const windowText = ({ center, width }: Window): string => {
  const digits = clamp(4 - Math.floor(Math.log10(Math.max(width - 1, 1e-9))), 0, 12);
  return list([center, width], digits);
};

export function writeAddress(state: ViewState, shown: ReadyCase): string {
  const first = firstState(shown);
  const pairs: [string, string][] = [];
  const say = (key: string, text: string, usual: string): void => {
    if (text !== usual) pairs.push([key, text]);
  };
  const name = viewName(state.orientation);
  say("d", short(state.depth_mm, 2), short(first.depth_mm, 2));
  if (name) say("v", name, "left");
  else say("q", list(state.orientation, 4), "");
  say("z", short(state.zoom, 3), "1");
  say("p", list(state.pan_mm, 1), "0,0");
  say("w", windowText(state.window), windowText(first.window));
  say("m", state.colormap, first.colormap);
  say("s", short(state.slab_mm, 1), "0");
  say("a", short(state.ambient, 2), short(first.ambient, 2));
  say("r", state.way, first.way);
  say("l", state.layout, first.layout);
  say("c", state.convention === "neurological" ? "n" : "", "");
  say("x", state.crosshair_mm ? list(state.crosshair_mm, 1) : "", "");
  return `#${[shown.id, ...pairs.map(([key, text]) => `${key}=${text}`)].join("&")}`;
}

/** The numbers of a text with commas, exactly so many, all finite; else null. */
function numbers(text: string | undefined, count: number): number[] | null {
  if (!text) return null;
  const values = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  return values.length === count && values.every(Number.isFinite) ? values : null;
}

export function readState(rest: string, shown: ReadyCase): ViewState {
  const first = firstState(shown);
  const said = new Map(
    rest.split("&").map((pair): [string, string] => {
      const at = pair.indexOf("=");
      return [pair.slice(0, Math.max(at, 0)), pair.slice(at + 1)];
    }),
  );
  const one = (key: string): number | null => numbers(said.get(key), 1)?.[0] ?? null;
  const depth = one("d");
  const zoom = one("z");
  const slab = one("s");
  const ambient = one("a");
  const pan = numbers(said.get("p"), 2) as Vec2 | null;
  const window = numbers(said.get("w"), 2) as Vec2 | null;
  const turned = numbers(said.get("q"), 4) as Quat | null;
  const crosshair = numbers(said.get("x"), 3) as Vec3 | null;
  const view = VIEW_NAMES.find((name) => name === said.get("v"));
  const { center_in_patient, radius_mm } = shown.envelope_sphere;
  const isNear = (position: Vec3): boolean =>
    position.every((value, axis) => Math.abs(value - (center_in_patient[axis] ?? 0)) <= 2 * radius_mm);
  return {
    depth_mm: depth === null ? first.depth_mm : clampDepth(depth, shown),
    orientation: (turned && unit(turned)) ?? (view ? NAMED_VIEWS[view] : first.orientation),
    zoom: zoom === null ? first.zoom : clamp(zoom, ...ZOOM_RANGE),
    pan_mm: pan
      ? [clamp(pan[0], -PAN_LIMIT_MM, PAN_LIMIT_MM), clamp(pan[1], -PAN_LIMIT_MM, PAN_LIMIT_MM)]
      : first.pan_mm,
    window: window && window[1] >= 1 ? boundWindow({ center: window[0], width: window[1] }, shown) : first.window,
    colormap: COLORMAPS.find((name) => name === said.get("m")) ?? first.colormap,
    slab_mm: slab === null ? first.slab_mm : clamp(slab, 0, SLAB_LIMIT_MM),
    ambient: ambient === null ? first.ambient : clamp(ambient, 0, 1),
    way: WAYS.find((name) => name === said.get("r")) ?? first.way,
    layout: LAYOUTS.find((name) => name === said.get("l")) ?? first.layout,
    convention: said.get("c") === "n" ? "neurological" : first.convention,
    crosshair_mm: crosshair && isNear(crosshair) ? crosshair : null,
  };
}
