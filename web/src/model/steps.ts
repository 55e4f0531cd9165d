// Protocols of a reading: lists of views that are gone through one after the other. Pure.

import type { ViewName } from "./camera.ts";
import type { SavedLayout } from "./saved-layouts.ts";

/** A view of a protocol, as a layout that is not saved. */
export interface Step extends Partial<SavedLayout> {
  /** Tells it from the others; it is counted by that. */
  readonly name: string;
  /** What of the case it is about, if it is no view of the head. */
  readonly shows?: "places" | "flair" | "findings";
}

/** Nothing lies over the picture. */
const PLAIN = { map: "", surface: "whole", has_inner: false } as const;
/** At this depth the cut meets most of the sulci, and is near to the crowns of the gyri. */
const DEPTH_MM = 8;

const side = (view: ViewName, depth_mm = DEPTH_MM): Step => ({
  ...PLAIN,
  name: `${view} ${depth_mm}`,
  layout: "single",
  view,
  depth_mm,
});

/** A half, seen from where the other one is. */
const inside = (surface: "left" | "right", view: ViewName): Step => ({
  ...side(view),
  name: `${surface} inner`,
  surface,
});

const mirror = (depth_mm = DEPTH_MM): Step => ({
  ...side("left", depth_mm),
  name: `mirror ${depth_mm}`,
  layout: "mirror",
});

const MAP: Step = { ...side("left"), name: "map", layout: "map" };

const about = (shows: NonNullable<Step["shows"]>): Step => ({ ...side("left"), name: shows, layout: "both", shows });

const INNER = [inside("left", "right"), inside("right", "left")];
const LAST = [about("places"), about("flair"), about("findings")];

export const PROTOCOLS = {
  complete: [side("left"), side("right"), ...INNER, MAP, ...LAST],
  mirrored: [mirror(), MAP, ...LAST],
  depths: [...[6, 10, 15, 20].map(mirror), ...INNER, ...LAST],
} as const satisfies Readonly<Record<string, readonly Step[]>>;
/** One of those that ship, or one's own. */
export type Protocol = keyof typeof PROTOCOLS | "own";
export const isProtocol = (name: unknown): name is Protocol =>
  name === "own" || (typeof name === "string" && Object.hasOwn(PROTOCOLS, name));
