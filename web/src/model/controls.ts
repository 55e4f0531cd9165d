// From hands to changes of the state: pure, in pixels of a pane.

import { NAMED_VIEWS, type View, type ViewName, project } from "./camera.ts";
import type { Intensity, ReadyCase, Window } from "./case.ts";
import type { Judgement } from "./findings.ts";
import { MAP_RADIUS_MM } from "./flat-map.ts";
import type { MapName } from "./maps.ts";
import type { SurfaceName } from "./surfaces.ts";
import { type Plane, type Vec2, clamp, compose, turnAbout, unit } from "./space.ts";
import {
  type Place,
  type ViewState,
  type WindowPreset,
  DEPTH_STEP_MM,
  FINE_DEPTH_STEP_MM,
  PAN_LIMIT_MM,
  ZOOM_RANGE,
  clampDepth,
  stepDepth,
  textureOf,
  windowBetween,
} from "./state.ts";

export type Change = Partial<ViewState>;

/** What an upward drag with the right button does to the window. */
export const DRAG_DIRECTIONS = ["up-brighter", "up-darker"] as const;
export type DragDirection = (typeof DRAG_DIRECTIONS)[number];

/** What the wheel does by itself; with alt it does the other. */
export const WHEEL_USES = ["zoom", "depth"] as const;
export type WheelUse = (typeof WHEEL_USES)[number];

/**
 * A drag by `move` pixels turns the head as a ball that rolls under the hand, about an axis in the plane of the
 * picture: no direction is special, so there is no pole. Half the smaller side is one radian.
 */
export function turn(state: ViewState, move: Vec2, size: Vec2): Change {
  const [right, down] = move;
  const angle_rad = Math.hypot(right, down) / (0.5 * Math.min(...size));
  if (!(angle_rad > 0)) return {};
  return { orientation: unit(compose(turnAbout([down, right, 0], angle_rad), state.orientation)) ?? state.orientation };
}

const panned = (x: number, y: number): Pick<ViewState, "pan_mm"> => ({
  pan_mm: [clamp(x, -PAN_LIMIT_MM, PAN_LIMIT_MM), clamp(y, -PAN_LIMIT_MM, PAN_LIMIT_MM)],
});

/** A drag by `move` pixels takes the head with it. */
export function pan(state: View, shown: ReadyCase, move: Vec2, size: Vec2): Pick<ViewState, "pan_mm"> {
  const { mm_per_pixel } = project(state, shown.envelope_sphere, size);
  return panned(state.pan_mm[0] + move[0] * mm_per_pixel, state.pan_mm[1] - move[1] * mm_per_pixel);
}

/** Zooms by `factor`; what is at `place` stays there. */
export function zoomAt(
  state: View,
  shown: ReadyCase,
  factor: number,
  place: Vec2,
  size: Vec2,
): Pick<ViewState, "zoom" | "pan_mm"> {
  const zoom = clamp(state.zoom * factor, ...ZOOM_RANGE);
  const before = project(state, shown.envelope_sphere, size).mm_per_pixel;
  const shift = before * (state.zoom / zoom) - before;
  return {
    zoom,
    ...panned(state.pan_mm[0] + (place[0] - size[0] / 2) * shift, state.pan_mm[1] - (place[1] - size[1] / 2) * shift),
  };
}

/** A drag by `move` pixels takes the flat map with it, of which a radius has so many pixels. */
export function panMap({ map }: Pick<ViewState, "map">, move: Vec2, pixels_per_unit: number): Pick<ViewState, "map"> {
  const mm_per_pixel = MAP_RADIUS_MM / pixels_per_unit;
  const { pan_mm } = panned(map.pan_mm[0] + move[0] * mm_per_pixel, map.pan_mm[1] - move[1] * mm_per_pixel);
  return { map: { ...map, pan_mm } };
}

/** Zooms the flat map by `factor`; what is `away` pixels from the middle of the pane stays there. */
export function zoomMap(
  { map }: Pick<ViewState, "map">,
  factor: number,
  away: Vec2,
  pixels_per_unit: number,
): Pick<ViewState, "map"> {
  const zoom = clamp(map.zoom * factor, ...MAP_ZOOM_RANGE);
  const grown = zoom / map.zoom;
  const shift: Vec2 = [away[0] * (1 - grown), away[1] * (1 - grown)];
  return panMap({ map: { ...map, zoom } }, shift, pixels_per_unit * grown);
}

/** The pixels of a drag that change the window by the case's own width. */
const WINDOW_DRAG_PIXELS = 400;

/** A drag by `move` pixels: right is wider; up is brighter or darker, as is preferred. */
export function dragWindow(state: ViewState, shown: ReadyCase, move: Vec2, drag: DragDirection): Change {
  const texture = textureOf(state, shown);
  const perPixel = (texture.intensity.window.width - 1) / WINDOW_DRAG_PIXELS;
  // A higher level is a darker picture.
  const level = (drag === "up-darker" ? -move[1] : move[1]) * perPixel;
  return {
    window: boundWindow(
      { center: state.window.center + level, width: state.window.width + move[0] * perPixel },
      texture,
    ),
  };
}

/**
 * The nearest window that is of use: from black to white a 500th of the range of the intensities to twice it, and black
 * nowhere below the lowest intensity.
 */
export function boundWindow(window: Window, { intensity }: { readonly intensity: Intensity }): Window {
  const { min, max } = intensity;
  const range = Math.max(max - min, intensity.window.width - 1);
  const width = clamp(window.width, 1 + range / 500, 1 + 2 * range);
  const lowest = windowBetween(min, min + width - 1).center;
  return { center: clamp(window.center, lowest, max + range + 0.5), width };
}

/** Deeper by `steps` steps, fine or not. */
export function deepen(state: ViewState, shown: ReadyCase, steps: number, fine: boolean): Change {
  return { depth_mm: clampDepth(stepDepth(state.depth_mm, steps, fine ? FINE_DEPTH_STEP_MM : DEPTH_STEP_MM), shown) };
}

/** Two fingers: where each was, and where each is. */
export interface Pinch {
  readonly from: readonly [Vec2, Vec2];
  readonly to: readonly [Vec2, Vec2];
}

/** The head follows two fingers: zoomed by their distance, moved by their middle. */
export function pinch(state: View, shown: ReadyCase, fingers: Pinch, size: Vec2): Pick<ViewState, "zoom" | "pan_mm"> {
  const { factor, about, move } = pinched(fingers);
  const zoomed = { ...state, ...zoomAt(state, shown, factor, about, size) };
  return { zoom: zoomed.zoom, ...pan(zoomed, shown, move, size) };
}

/** By what two fingers zoom, about which place, and how far their middle moves. */
export function pinched({ from, to }: Pinch): { readonly factor: number; readonly about: Vec2; readonly move: Vec2 } {
  const middle = ([a, b]: readonly [Vec2, Vec2]): Vec2 => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  const apart = ([a, b]: readonly [Vec2, Vec2]): number => Math.max(Math.hypot(a[0] - b[0], a[1] - b[1]), 1);
  const [before, after] = [middle(from), middle(to)];
  return { factor: apart(to) / apart(from), about: before, move: [after[0] - before[0], after[1] - before[1]] };
}

/** Browsers that count lines have three of them to a notch, the others 100 or 120 pixels. */
const LINE_PIXELS = 40;
/** `WheelEvent.DOM_DELTA_PIXEL`. */
const IN_PIXELS = 0;

/** A map that is smaller than its pane shows no more. */
const MAP_ZOOM_RANGE = [1, 20] as const;

/** A wheel's movement in pixels; positive is towards the user. */
export function wheelPixels({
  deltaX,
  deltaY,
  deltaMode,
}: Pick<WheelEvent, "deltaX" | "deltaY" | "deltaMode">): number {
  // Some systems turn the wheel sideways while alt or shift is held.
  const delta = deltaY || deltaX;
  return deltaMode === IN_PIXELS ? delta : delta * LINE_PIXELS;
}

/** Whole notches out of a wheel's or a touchpad's movement, in pixels. */
export class Notches {
  #moved = 0;

  take(pixels: number): number {
    if (Math.abs(pixels) >= LEAST_NOTCH_PIXELS) {
      this.#moved = 0;
      return Math.sign(pixels) * Math.max(Math.round(Math.abs(pixels) / NOTCH_PIXELS), 1);
    }
    // What is left over from the other direction is forgotten.
    if (this.#moved * pixels < 0) this.#moved = 0;
    this.#moved += pixels;
    const whole = Math.trunc(this.#moved / TOUCHPAD_PIXELS);
    this.#moved -= whole * TOUCHPAD_PIXELS;
    return whole;
  }
}

/** A wheel's notch, and what is so much at once that it is one; a touchpad's smaller movements are added up. */
const NOTCH_PIXELS = 120;
const LEAST_NOTCH_PIXELS = 50;
const TOUCHPAD_PIXELS = 60;

/** The zoom of a wheel's movement in pixels: a notch of 100 pixels is a sixth more or less. */
export const wheelZoom = (pixels: number): number => Math.exp(-clamp(pixels, -300, 300) * 0.0015);

/** What changes the state and does nothing else. */
export type ChangingCommand =
  | { readonly kind: "depth"; readonly steps: number; readonly fine: boolean }
  | { readonly kind: "turn" | "pan"; readonly move: Vec2 }
  | { readonly kind: "zoom"; readonly factor: number }
  | { readonly kind: "view"; readonly name: ViewName }
  | { readonly kind: "window"; readonly preset: WindowPreset }
  /** Over the picture, or not any more. */
  | { readonly kind: "map"; readonly name: MapName }
  /** A surface, or the next one. */
  | { readonly kind: "surface"; readonly name: SurfaceName | null }
  | { readonly kind: "invert" | "reset" };

export type LayerCommand =
  /** The next of the added layers, as grey texture or in colours. */
  | { readonly kind: "grey" | "colours" }
  /**
   * A line divides the picture without them from the one with them;
   * slices show the edges of one; one is moved by hand; two halves are compared side by side, and exchanged.
   */
  | { readonly kind: "swipe" | "edges" | "nudge" | "beside" | "swap" };

/** What panes show, and in which planes. */
export type PaneCommand =
  /** The series of an id in a pane, or in the one that a hand was in last; without an id, the next one. */
  | { readonly kind: "series"; readonly id?: string; readonly pane?: Place }
  /** All slices in a plane, or each in its own; without a plane, the next of these. */
  | { readonly kind: "plane"; readonly plane?: Plane | "three" }
  /** The slices of a plane, or of the one that a hand was in last, go through the head, or stop. */
  | { readonly kind: "cine"; readonly plane?: Plane }
  /** The same in all panes; the strip of series is shown or hidden. */
  | { readonly kind: "alike" | "strip" };

export type Command =
  | ChangingCommand
  | LayerCommand
  | PaneCommand
  /** The next row of the list of places and findings, or the one before. */
  | { readonly kind: "row"; readonly steps: number }
  /** The next step of the protocol, or the one before. */
  | { readonly kind: "step"; readonly steps: number }
  /** About the place or finding at the mark. */
  | { readonly kind: "judge"; readonly judgement: Judgement }
  | { readonly kind: "recall"; readonly number: number }
  | {
      readonly kind:
        | "help"
        /** What was opened last: a pane as large as all, the close-up, the slice across. */
        | "leave"
        | "play"
        | "timer"
        | "mark"
        | "closer"
        | "across"
        | "ruler"
        | "layouts"
        | "outline"
        /** All that lies over the head is hidden as long as a key is held. */
        | "hold"
        | "release"
        | "undo"
        | "redo"
        | "patient"
        /** Nothing but the pictures, or all of the page. */
        | "alone"
        /** The flat map, or on it the inner sides. */
        | "flat-map";
    };

/** The colours with black and white changed over; of coloured maps, inverted grey. */
export const invert = (state: ViewState): Change => ({ colormap: state.colormap === "inverted" ? "grey" : "inverted" });

/** The camera of a named view: its direction, centred. */
export const lookFrom = (name: ViewName): Change => ({ orientation: NAMED_VIEWS[name], pan_mm: [0, 0] });
