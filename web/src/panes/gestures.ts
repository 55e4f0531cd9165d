// Pointers, wheel and touch on a pane, as drags, pinches and clicks.

import type { ReadonlySignal } from "@preact/signals";

import type { Vec2 } from "../model/space.ts";
import { Notches, type Pinch, wheelPixels } from "../model/controls.ts";

type DragKind = "turn" | "pan" | "window";

export interface Gestures {
  /** A hand came down; a finger may also be about to scroll the page. */
  press?(kind: DragKind, place: Vec2, isFinger: boolean): void;
  /** The system took the gesture away, to scroll the page for one. */
  cancel?(): void;
  drag(kind: DragKind, move: Vec2, place: Vec2): void;
  pinch(pinch: Pinch): void;
  /** The wheel, in pixels; `notches` are whole ones, for steps. Positive is towards the user. */
  wheel(pixels: number, notches: number, place: Vec2, event: WheelEvent): void;
  /** A hand came down and left without moving. */
  tap?(place: Vec2): void;
  pick(place: Vec2): void;
  /** A hand rests on the pane, or has left it: pictures in between may be coarse. */
  busy(busy: boolean): void;
}

const kindOf = (event: PointerEvent, moves: boolean): DragKind => {
  if (event.button === 2) return "window";
  return event.button === 1 || event.shiftKey !== moves ? "pan" : "turn";
};

/** A hand that moves by no more than this has not moved, in CSS pixels. */
export const STILL_PIXELS = 4;

/** Listens to a pane, where a drag may move what is shown; its places are CSS pixels from the pane's top left corner. */
export function listen(pane: HTMLElement, gestures: Gestures, moves: ReadonlySignal<boolean>): void {
  const touches = new Map<number, Vec2>();
  const notches = new Notches();
  let kind: DragKind = "turn";
  /** Where the hand came down, as long as it has not moved, and is alone. */
  let still: Vec2 | null = null;

  const placeOf = (event: MouseEvent): Vec2 => {
    const box = pane.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const end = (event: PointerEvent): void => {
    if (!touches.delete(event.pointerId)) return;
    if (event.type === "pointercancel") gestures.cancel?.();
    if (touches.size > 0) return;
    if (still && event.type === "pointerup" && kind === "turn") gestures.tap?.(still);
    gestures.busy(false);
  };

  pane.addEventListener("pointerdown", (event) => {
    if (!(event.target instanceof Element) || event.target.closest("button, input")) return;
    // A third finger, or a mouse beside a finger, changes nothing.
    if (touches.size >= 2) return;
    pane.setPointerCapture(event.pointerId);
    if (touches.size === 0) {
      kind = kindOf(event, moves.peek());
      still = placeOf(event);
      gestures.busy(true);
      gestures.press?.(kind, placeOf(event), event.pointerType === "touch");
    }
    touches.set(event.pointerId, placeOf(event));
    if (touches.size > 1) still = null;
    pane.closest<HTMLElement>("[tabindex]")?.focus({ preventScroll: true });
    // Else the middle button scrolls the page.
    event.preventDefault();
  });
  pane.addEventListener("pointermove", (event) => {
    const before = touches.get(event.pointerId);
    if (!before) return;
    const now = placeOf(event);
    if (still && Math.hypot(now[0] - still[0], now[1] - still[1]) > STILL_PIXELS) still = null;
    touches.set(event.pointerId, now);
    const other = [...touches].find(([id]) => id !== event.pointerId)?.[1];
    if (other) gestures.pinch({ from: [before, other], to: [now, other] });
    else gestures.drag(kind, [now[0] - before[0], now[1] - before[1]], now);
  });
  // A touch that the system takes away (a call, a palm) ends the gesture where it is.
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"] as const) pane.addEventListener(name, end);
  pane.addEventListener("dblclick", (event) => {
    if (event.target instanceof Element && event.target.closest("button, input")) return;
    gestures.pick(placeOf(event));
  });
  pane.addEventListener("contextmenu", (event) => event.preventDefault());
  pane.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = wheelPixels(event);
      gestures.wheel(pixels, notches.take(pixels), placeOf(event), event);
    },
    { passive: false },
  );
}
