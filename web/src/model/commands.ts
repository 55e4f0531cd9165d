// What a command makes of a state: pure.

import type { ReadyCase } from "./case.ts";
import { type Change, type ChangingCommand, deepen, invert, lookFrom, pan, turn, zoomAt } from "./controls.ts";
import type { Vec2 } from "./space.ts";
import { type ViewState, firstState, presetWindow } from "./state.ts";

/** `size` is that of the pane, in pixels; `isStep`: Back undoes it. */
export function changeOf(
  command: ChangingCommand,
  state: ViewState,
  shown: ReadyCase,
  size: Vec2,
): { readonly change: Change; readonly isStep: boolean } {
  switch (command.kind) {
    case "depth":
      return { change: deepen(state, shown, command.steps, command.fine), isStep: false };
    case "turn":
      return { change: turn(state, inThousandths(command.move, size), size), isStep: false };
    case "pan":
      return { change: pan(state, shown, inThousandths(command.move, size), size), isStep: false };
    case "zoom":
      return { change: zoomAt(state, shown, command.factor, [size[0] / 2, size[1] / 2], size), isStep: false };
    case "view":
      return { change: lookFrom(command.name), isStep: true };
    case "window":
      return { change: { window: presetWindow(command.preset, shown) }, isStep: true };
    case "invert":
      return { change: invert(state), isStep: true };
    case "reset": {
      const { layout, way, convention } = state;
      return { change: { ...firstState(shown), layout, way, convention }, isStep: true };
    }
  }
}

/** A move in thousandths of the pane's smaller side, in pixels. */
function inThousandths([x, y]: Vec2, size: Vec2): Vec2 {
  const unit = Math.min(...size) / 1000;
  return [x * unit, y * unit];
}
