// The state in the address: `#<case>&d=8.5&v=left`. What is as at first is left out; what is not understood is passed
// over.

import { short } from "./text.ts";
import { NAMED_VIEWS, VIEW_NAMES, viewName } from "./camera.ts";
import type { ReadyCase, Window } from "./case.ts";
import { type Change, boundWindow } from "./controls.ts";
import { isLayerId, overlayText, readOverlay } from "./maps.ts";
import { PLANE_NAMES, type Quat, type Vec2, type Vec3, clamp, unit } from "./space.ts";
import { SURFACES } from "./surfaces.ts";
import { type Filter, LIST, readFilter } from "./worklist.ts";
import {
  type HalfLook,
  type ViewState,
  COLORMAPS,
  LAYOUTS,
  LOOK,
  LOOK_KEYS,
  PAN_LIMIT_MM,
  type Place,
  SLOTS,
  SLOT_NAMES,
  WAYS,
  ZOOM_RANGE,
  boundOutlines,
  clampDepth,
  firstState,
  halfOf,
  lookAt,
  withLook,
} from "./state.ts";

export type Address =
  | { readonly kind: "none" }
  | OfCase
  /** The list of cases, with its filter. */
  | { readonly kind: "list"; readonly filter: Filter }
  /** Something that is no case. */
  | { readonly kind: "unknown" };

/** A case, and its state in a form that only the case can read. */
export interface OfCase {
  readonly kind: "case";
  readonly id: string;
  readonly rest: string;
  /** The finding that a link leads to; empty: none. */
  readonly finding: string;
}

const FINDING = "finding=";

/** The address of a finding, which leads to its place. */
export const findingAddress = (id: string, finding: string): string => `#${id}&${FINDING}${finding}`;

export function readAddress(fragment: string): Address {
  const text = fragment.replace(/^#/, "");
  const [first = "", ...parts] = text.split("&");
  const finding = parts.find((one) => one.startsWith(FINDING)) ?? "";
  const rest = parts.filter((one) => one !== finding).join("&");
  if (/^[0-9a-f]{32}$/.test(first)) return { kind: "case", id: first, rest, finding: finding.slice(FINDING.length) };
  if (first === LIST) return { kind: "list", filter: readFilter(parts) };
  return { kind: text === "" ? "none" : "unknown" };
}

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
  say("f", state.surface, first.surface);
  say("d", short(state.depth_mm, 2), short(first.depth_mm, 2));
  if (name) say("v", name, "left");
  else say("q", list(state.orientation, 4), "");
  say("z", short(state.zoom, 3), "1");
  say("p", list(state.pan_mm, 1), "0,0");
  const sayHalf = ({ layer, overlay, window, colormap }: HalfLook, side: string): void => {
    say(`${side}y`, layer?.id ?? "", "");
    // The first window of a layer is not known everywhere.
    say(`${side}w`, windowText(window), layer ? "" : windowText(first.window));
    say(`${side}m`, colormap, first.colormap);
    say(`${side}b`, overlay ? overlayText(overlay) : "", "");
  };
  sayHalf(state, "");
  say("t", state.beside ? "1" : "", "");
  if (state.beside) sayHalf(state.beside, "t");
  for (const slot of SLOT_NAMES) {
    const own = state.panes[slot];
    if (!own) continue;
    say(SLOTS[slot], "1", "");
    sayHalf(own, SLOTS[slot]);
  }
  say("n", state.plane ?? "", "");
  say("e", state.swipe ? short(state.swipe.share, 2) : "", "");
  say("h", state.has_edges ? "1" : "", "");
  for (const key of LOOK_KEYS)
    say(LOOK[key].letter, short(state[key], LOOK[key].digits), short(first[key], LOOK[key].digits));
  say("g", state.averages_shallow ? "1" : "0", "1");
  say("r", state.way, first.way);
  say("l", state.layout, first.layout);
  say("j", list([state.map.zoom, ...state.map.pan_mm], 2), list([1, 0, 0], 2));
  say("i", state.map.has_inner ? "1" : "", "");
  say("c", state.convention === "neurological" ? "n" : "", "");
  say("o", list(state.outlines_mm, 1), "");
  say("x", state.crosshair_mm ? list(state.crosshair_mm, 2) : "", "");
  say("u", state.across_deg === null ? "" : short(state.across_deg, 1), "");
  return `#${[shown.id, ...pairs.map(([key, text]) => `${key}=${text}`)].join("&")}`;
}

/** The numbers of a text with commas, exactly so many, all finite; else null. */
function numbers(text: string | undefined, count: number): number[] | null {
  if (!text) return null;
  const values = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  return values.length === count && values.every(Number.isFinite) ? values : null;
}

/** What an address says of a case, and the parts of it that could not be taken as they are. */
export interface ReadState {
  readonly state: ViewState;
  readonly unread: readonly string[];
}

/** Whether a number was left as it is when it was brought into its range, to a hundredth. */
const isKept = (before: number, after: number): boolean => Math.abs(before - after) <= 0.0051;

/** The changes of the state by each part of an address; null if its text is invalid or out of range. */
function readers(shown: ReadyCase): Readonly<Record<string, (text: string, before: ViewState) => Reading>> {
  const { center_in_patient, radius_mm } = shown.envelope_sphere;
  const number = (text: string, low: number, high: number, change: (value: number) => Change): Reading => {
    const [value] = numbers(text, 1) ?? [];
    if (value === undefined) return UNREAD;
    const kept = clamp(value, low, high);
    return { change: change(kept), isWhole: isKept(value, kept) };
  };
  const word = <Word extends string>(text: string, words: readonly Word[], change: (word: Word) => Change): Reading => {
    const found = words.find((one) => one === text);
    return found === undefined ? UNREAD : { change: change(found), isWhole: true };
  };
  const ofLook = LOOK_KEYS.map((key) => [
    LOOK[key].letter,
    (text: string): Reading => number(text, 0, LOOK[key].most, (value) => ({ [key]: value })),
  ]);
  const ofPanes = SLOT_NAMES.map((slot) => [
    SLOTS[slot],
    (text: string, before: ViewState): Reading =>
      word(text, ["1"], () => withLook(before, slot, halfOf(firstState(shown)))),
  ]);
  return {
    ...Object.fromEntries(ofLook),
    ...Object.fromEntries(ofPanes),
    f: (text) => word(text, SURFACES, (surface) => ({ surface })),
    d: (text) => number(text, 0, clampDepth(Infinity, shown), (depth) => ({ depth_mm: clampDepth(depth, shown) })),
    v: (text) => word(text, VIEW_NAMES, (view) => ({ orientation: NAMED_VIEWS[view] })),
    q: (text) => {
      const turned = numbers(text, 4) as Quat | null;
      const orientation = turned && unit(turned);
      return orientation ? { change: { orientation }, isWhole: true } : UNREAD;
    },
    z: (text) => number(text, ...ZOOM_RANGE, (zoom) => ({ zoom })),
    p: (text) => {
      const pan = numbers(text, 2) as Vec2 | null;
      if (!pan) return UNREAD;
      const kept: Vec2 = [clamp(pan[0], -PAN_LIMIT_MM, PAN_LIMIT_MM), clamp(pan[1], -PAN_LIMIT_MM, PAN_LIMIT_MM)];
      return { change: { pan_mm: kept }, isWhole: pan.every((value, axis) => isKept(value, kept[axis] ?? 0)) };
    },
    y: (text) => (isLayerId(text) ? { change: { layer: { id: text } }, isWhole: true } : UNREAD),
    w: (text, { layer }) => {
      const [center, width] = numbers(text, 2) ?? [];
      if (center === undefined || width === undefined || width < 1) return UNREAD;
      // The values of a layer are not known yet.
      const window = layer ? { center, width } : boundWindow({ center, width }, shown);
      const tolerance = 1e-3 * width;
      const isWhole = Math.abs(window.center - center) <= tolerance && Math.abs(window.width - width) <= tolerance;
      return { change: { window }, isWhole };
    },
    m: (text) => word(text, COLORMAPS, (colormap) => ({ colormap })),
    b: (text) => {
      const read = readOverlay(text);
      return read ? { change: { overlay: read.overlay }, isWhole: read.isWhole } : UNREAD;
    },
    t: (text) => word(text, ["1"], () => ({ beside: halfOf(firstState(shown)) })),
    n: (text) => word(text, PLANE_NAMES, (plane) => ({ plane })),
    e: (text) => number(text, 0, 1, (share) => ({ swipe: { share } })),
    h: (text) => word(text, ["1"], () => ({ has_edges: true })),
    g: (text) => word(text, ["0", "1"], (averages) => ({ averages_shallow: averages === "1" })),
    r: (text) => word(text, WAYS, (way) => ({ way })),
    l: (text) => word(text, LAYOUTS, (layout) => ({ layout })),
    j: (text, { map }) => {
      const [zoom, ...pan] = numbers(text, 3) ?? [];
      if (!zoom) return UNREAD;
      const bound = (value = 0): number => clamp(value, -PAN_LIMIT_MM, PAN_LIMIT_MM);
      const kept = { zoom: clamp(zoom, 1, ZOOM_RANGE[1]), pan_mm: [bound(pan[0]), bound(pan[1])] as const };
      const isWhole = kept.zoom === zoom && kept.pan_mm.every((part, axis) => part === pan[axis]);
      return { change: { map: { ...map, ...kept } }, isWhole };
    },
    i: (text, { map }) => word(text, ["1"], () => ({ map: { ...map, has_inner: true } })),
    c: (text) => word(text, ["n"], () => ({ convention: "neurological" })),
    o: (text) => {
      const depths = numbers(text, text.split(",").length);
      const kept = depths && boundOutlines(depths, shown);
      return kept ? { change: { outlines_mm: kept }, isWhole: kept.length === depths.length } : UNREAD;
    },
    u: (text) => number(text, -90, 90, (across_deg) => ({ across_deg })),
    x: (text) => {
      const position = numbers(text, 3) as Vec3 | null;
      const isNear = position?.every(
        (value, axis) => Math.abs(value - (center_in_patient[axis] ?? 0)) <= 2 * radius_mm,
      );
      return position && isNear ? { change: { crosshair_mm: position }, isWhole: true } : UNREAD;
    },
  };
}

interface Reading {
  readonly change: Change;
  /** Whether all of the part was taken as it is. */
  readonly isWhole: boolean;
}

const UNREAD: Reading = { change: {}, isWhole: false };

/** Whose look the letter means before those of a look; null if it has none of its own. */
function placeAt(letter: string, { beside, panes }: ViewState): Place | null {
  if (letter === "t") return beside && "left";
  const slot = SLOT_NAMES.find((one) => SLOTS[one] === letter);
  return slot && panes[slot] ? slot : null;
}

/** `base` is the state of what the address does not say. */
export function readState(rest: string, shown: ReadyCase, base: ViewState = firstState(shown)): ReadState {
  const byKey = readers(shown);
  const unread: string[] = [];
  let state = base;
  for (const part of rest.split("&").filter((one) => one !== "")) {
    const at = part.indexOf("=");
    const key = part.slice(0, Math.max(at, 0));
    const read = (name: string, before: ViewState): Reading =>
      (Object.hasOwn(byKey, name) && byKey[name]?.(part.slice(at + 1), before)) || UNREAD;
    // What begins with a t is of the left half, and with a capital letter of a pane.
    const place = /^.[ywmb]$/.test(key) ? placeAt(key.charAt(0), state) : null;
    const look = place && { ...state, ...lookAt(state, place) };
    const { change, isWhole } = look ? read(key.slice(1), look) : read(key, state);
    state = { ...state, ...(look && place ? withLook(state, place, halfOf({ ...look, ...change })) : change) };
    if (!isWhole) unread.push(part);
  }
  return { state, unread };
}
