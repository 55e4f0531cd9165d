// The server's pictures in the place of the page's own, as long as they are wanted.

import type { ReadyCase } from "../model/case.ts";
import type { ViewState } from "../model/state.ts";
import { h } from "../base/dom.ts";
import { type ServedListener, type ServedSurface, createServerSurface } from "./server-surface.ts";

export class StandIn {
  readonly #canvas: HTMLCanvasElement;
  readonly #case: ReadyCase;
  readonly #listener: ServedListener;
  #server: { readonly surface: ServedSurface; readonly box: HTMLElement } | null = null;

  constructor(canvas: HTMLCanvasElement, shown: ReadyCase, listener: ServedListener) {
    this.#canvas = canvas;
    this.#case = shown;
    this.#listener = listener;
  }

  draw(state: ViewState, moving: boolean): void {
    this.#server ??= this.#made();
    this.#server.surface.draw(state, moving);
  }

  /** A picture of the state; null where the server does not draw. */
  picture(state: ViewState, ratio: number): Promise<CanvasImageSource> | null {
    return this.#server?.surface.picture(state, ratio) ?? null;
  }

  leave(): void {
    this.#server?.surface.dispose();
    this.#server?.box.remove();
    this.#server = null;
  }

  #made(): { readonly surface: ServedSurface; readonly box: HTMLElement } {
    const box = h("div", { class: "served" });
    this.#canvas.after(box);
    return { surface: createServerSurface(box, this.#case, this.#listener), box };
  }
}
