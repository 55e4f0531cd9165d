// What keys ask for: one table, which the keyboard, the help and the tips of buttons read.

import { VIEW_NAMES } from "./camera.ts";
import type { Command } from "./controls.ts";
import type { MapName } from "./maps.ts";
import type { Vec2 } from "./space.ts";
import { WINDOW_PRESETS } from "./state.ts";

/** A key, as a keyboard event has it. */
export interface Key {
  readonly key: string;
  readonly code: string;
  readonly shiftKey: boolean;
  readonly altKey: boolean;
  readonly ctrlKey: boolean;
  readonly metaKey: boolean;
}

/** How far an arrow turns and moves the head, in pixels of a drag over a pane whose smaller side is 1000. */
export const ARROW_PIXELS = 40;
export const ARROWS: Readonly<Record<string, Vec2>> = {
  ArrowLeft: [-ARROW_PIXELS, 0],
  ArrowRight: [ARROW_PIXELS, 0],
  ArrowUp: [0, -ARROW_PIXELS],
  ArrowDown: [0, ARROW_PIXELS],
};

/** The help names some keys in words of the page. */
type KeyName = "arrows" | "pages" | "views" | "presets" | "space" | "layouts" | "escape" | "undo";

/** A line of the help: its keys, by themselves or by a name, and what they ask for. */
interface Binding<Help extends string = string> {
  readonly help: Help;
  readonly keys: readonly string[] | KeyName;
  commandOf(key: Key): Command | null;
}

const bound = <const Help extends string>(
  help: Help,
  keys: readonly string[] | KeyName,
  commandOf: Binding["commandOf"],
): Binding<Help> => ({ help, keys, commandOf });

/** Keys that stand for themselves: small letters and signs without shift, capital ones with it. With caps lock a letter's case says nothing. */
const plain = <const Help extends string>(
  help: Help,
  commands: Readonly<Record<string, Command>>,
  name: KeyName | null = null,
): Binding<Help> =>
  bound(help, name ?? Object.keys(commands), ({ key, shiftKey }) => {
    const typed = key.length === 1 && !shiftKey ? key.toLowerCase() : key;
    return Object.hasOwn(commands, typed) ? (commands[typed] ?? null) : null;
  });

const map = (name: MapName): Command => ({ kind: "map", name });

/** In the order of the help. */
export const BINDINGS = [
  // By the place on the keyboard as well: on many keyboards the brackets cannot be typed without alt.
  bound("depth", ["[", "]"], ({ key, code, shiftKey }) => {
    if (key === "[" || key === "{" || code === "BracketLeft") return { kind: "depth", steps: -1, fine: shiftKey };
    const isMore = key === "]" || key === "}" || code === "BracketRight";
    return isMore ? { kind: "depth", steps: 1, fine: shiftKey } : null;
  }),
  plain(
    "pages",
    { PageUp: { kind: "depth", steps: -10, fine: false }, PageDown: { kind: "depth", steps: 10, fine: false } },
    "pages",
  ),
  bound("turn", "arrows", ({ key, shiftKey }) => {
    const move = ARROWS[key];
    return move ? { kind: shiftKey ? "pan" : "turn", move } : null;
  }),
  bound("views", "views", ({ key, shiftKey }) => {
    const view = VIEW_NAMES.find((name) => name[0] === key.toLowerCase());
    return view && shiftKey ? { kind: "view", name: view } : null;
  }),
  plain("surface", { q: { kind: "surface", name: null } }),
  bound("window", "presets", ({ key }) => {
    const preset = /^[1-6]$/.test(key) && WINDOW_PRESETS[Number(key) - 1];
    return preset ? { kind: "window", preset } : null;
  }),
  // Every small letter has its command: others are with shift.
  plain("maps", {
    u: map("blur"),
    y: map("thickness"),
    f: map("flair"),
    a: map("asymmetry"),
    t: map("intensity-asymmetry"),
    s: map("sharpness"),
    j: map("junction"),
  }),
  plain("rows", {
    ",": { kind: "row", steps: -1 },
    ".": { kind: "row", steps: 1 },
    U: { kind: "row", steps: -1 },
    J: { kind: "row", steps: 1 },
  }),
  // By the place on the keyboard as well: what it types with shift differs.
  bound("steps", ["0"], ({ key, code, shiftKey }) =>
    key === "0" || code === "Digit0" ? { kind: "step", steps: shiftKey ? -1 : 1 } : null,
  ),
  plain("judge", { K: { kind: "judge", judgement: "kept" }, D: { kind: "judge", judgement: "dismissed" } }),
  plain("layers", { l: { kind: "grey" }, c: { kind: "colours" } }),
  plain("series", { N: { kind: "series" }, E: { kind: "strip" } }),
  plain("plane", { T: { kind: "plane" } }),
  plain("cine", { C: { kind: "cine" } }),
  plain("blink", { b: { kind: "hold" } }),
  plain("swipe", { v: { kind: "swipe" } }),
  plain("edges", { e: { kind: "edges" } }),
  plain("beside", { p: { kind: "beside" } }),
  plain("swap", { w: { kind: "swap" } }),
  plain("nudge", { n: { kind: "nudge" } }),
  plain("zoom", {
    "+": { kind: "zoom", factor: 1.2 },
    "=": { kind: "zoom", factor: 1.2 },
    "-": { kind: "zoom", factor: 1 / 1.2 },
  }),
  plain("play", { " ": { kind: "play" } }, "space"),
  plain("mark", { Enter: { kind: "mark" } }),
  plain("closer", { z: { kind: "closer" } }),
  plain("across", { x: { kind: "across" } }),
  plain("flat-map", { m: { kind: "flat-map" } }),
  plain("ruler", { k: { kind: "ruler" } }),
  plain("layouts", { g: { kind: "layouts" } }, "layouts"),
  plain("leave", { Escape: { kind: "leave" } }, "escape"),
  plain("outline", { o: { kind: "outline" } }),
  // The list's own.
  bound("delete", ["Delete"], () => null),
  plain("alone", { V: { kind: "alone" } }),
  plain("patient", { d: { kind: "patient" } }),
  // With the control key.
  bound("undo", "undo", () => null),
  plain("rest", {
    i: { kind: "invert" },
    r: { kind: "reset" },
    F: { kind: "timer" },
    h: { kind: "help" },
    "?": { kind: "help" },
  }),
] as const;

/** The command of a key; null where it has none. */
export function commandOf(key: Key): Command | null {
  if (key.ctrlKey || key.metaKey) return key.altKey ? null : steppingOf(key);
  if (key.altKey) return null;
  for (const binding of BINDINGS) {
    const command = binding.commandOf(key);
    if (command) return command;
  }
  return null;
}

/** The key that asks for something, as the tip of a button names it; empty: none does. */
export function keyOf(isIt: (command: Command) => boolean): string {
  const without = { code: "", altKey: false, ctrlKey: false, metaKey: false };
  const letters: readonly string[] = BINDINGS.flatMap(({ keys }) => keys);
  const found = letters.find((key) => {
    const command = commandOf({ ...without, key, shiftKey: key !== key.toLowerCase() });
    return key.length === 1 && command !== null && isIt(command);
  });
  return found ?? "";
}

/** Whether the key undoes, or does again. */
function steppingOf({ key, shiftKey }: Key): Command | null {
  const letter = key.toLowerCase();
  if (letter === "y" && !shiftKey) return { kind: "redo" };
  return letter === "z" ? { kind: shiftKey ? "redo" : "undo" } : null;
}

/** The command of a key after `g`: a saved layout; null: the key is its own. */
export const recallOf = ({ key, ctrlKey, metaKey, altKey }: Key): Command | null =>
  /^[1-9]$/.test(key) && !ctrlKey && !metaKey && !altKey ? { kind: "recall", number: Number(key) } : null;
