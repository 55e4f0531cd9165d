// The server's pictures in the place of the page's own, as long as they are wanted: they follow the state, small while
// it moves, full when it rests.

import { mirrored } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { pictureSize, renderQuery } from "../model/query.ts";
import type { Vec2 } from "../model/space.ts";
import { type ViewState, isHalved, isMirrored, isStacked, leftOf, viewSize } from "../model/state.ts";
import { mirroredSurface } from "../model/surfaces.ts";
import { h } from "../base/dom.ts";
import { FollowingPicture, served } from "../base/picture.ts";
import { troubleWords } from "../base/problem-words.ts";

const FULL_PIXELS = 1024;
const MOVING_PIXELS = 320;
const MOST_PIXELS = 4096;

interface ServedListener {
  /** A picture of the server is up, in front of the canvas. */
  drawn(state: ViewState): void;
  trouble(words: string): void;
  /** The view as the server is asked for it. */
  served(view: ViewState): ViewState;
}

export class StandIn {
  readonly #canvas: HTMLCanvasElement;
  readonly #case: ReadyCase;
  readonly #listener: ServedListener;
  readonly #halves = ["whole", "other"].map((side) => h("div", { class: `server-picture ${side}` }));
  readonly #box = h("div", { class: "served" }, ...this.#halves);
  /** The picture of the pane, or those of both of its halves, which change together; null while none is wanted. */
  #picture: FollowingPicture<ViewState, readonly HTMLImageElement[]> | null = null;

  constructor(canvas: HTMLCanvasElement, shown: ReadyCase, listener: ServedListener) {
    this.#canvas = canvas;
    this.#case = shown;
    this.#listener = listener;
  }

  draw(state: ViewState, moving: boolean): void {
    const picture = (this.#picture ??= this.#begin());
    const size = this.#size(state, devicePixelRatio, moving ? MOVING_PIXELS : FULL_PIXELS);
    const paths = this.#views(state).map((view) => this.#path(view, size));
    // What is drawn over a picture, as the cross, needs no other one.
    if (picture.show(paths.join(" "), state)) this.#listener.drawn(state);
  }

  /** A picture of the state, with so many pixels to a CSS pixel; null where the server does not draw. */
  picture(state: ViewState, ratio: number): Promise<CanvasImageSource> | null {
    return this.#picture ? this.#whole(state, ratio) : null;
  }

  leave(): void {
    this.#picture?.stop();
    this.#picture = null;
    for (const half of this.#halves) half.replaceChildren();
    this.#box.remove();
  }

  async #whole(state: ViewState, ratio: number): Promise<CanvasImageSource> {
    const size = this.#size(state, ratio, MOST_PIXELS);
    const views = this.#views(state);
    const pictures = await Promise.all(views.map((view) => served({ path: this.#path(view, size) })));
    const [right, down] = isStacked(state, this.#paneSize) ? [0, 1] : [1, 0];
    const last = views.length - 1;
    const canvas = h("canvas", { width: size[0] * (1 + last * right), height: size[1] * (1 + last * down) });
    const context = canvas.getContext("2d");
    for (const [at, picture] of pictures.entries()) {
      if (at > 0 && isMirrored(state)) context?.setTransform(-1, 0, 0, 1, canvas.width + right * size[0], 0);
      context?.drawImage(picture, at * right * size[0], at * down * size[1]);
    }
    return canvas;
  }

  /** The views that the server draws: of a mirrored half before it is flipped. */
  #views(state: ViewState): readonly ViewState[] {
    const { envelope_sphere: sphere } = this.#case;
    if (isMirrored(state)) {
      const surface = mirroredSurface(state.surface);
      return [state, { ...state, ...mirrored(state, this.#case.midsagittal, sphere), surface }];
    }
    return state.beside ? [leftOf(state), state] : [state];
  }

  #path(view: ViewState, size: Vec2): string {
    return `${this.#case.id}/render?${renderQuery(this.#listener.served(view), size)}`;
  }

  #size(state: ViewState, ratio: number, most: number): Vec2 {
    return pictureSize(viewSize(state, this.#paneSize), ratio, most);
  }

  get #paneSize(): Vec2 {
    return [this.#box.clientWidth, this.#box.clientHeight];
  }

  #begin(): FollowingPicture<ViewState, readonly HTMLImageElement[]> {
    this.#canvas.after(this.#box);
    const put = (images: readonly HTMLImageElement[], state: ViewState): void => {
      for (const [at, half] of this.#halves.entries()) half.replaceChildren(...images.slice(at, at + 1));
      this.#box.classList.toggle("halved", isHalved(state));
      this.#box.classList.toggle("stacked", isStacked(state, this.#paneSize));
      this.#box.classList.toggle("mirrored", isMirrored(state));
      this.#listener.drawn(state);
    };
    const complain = (problem: unknown): void => this.#listener.trouble(troubleWords(problem));
    return new FollowingPicture({ put, complain }, ({ path }) =>
      Promise.all(path.split(" ").map((one) => served({ path: one }))),
    );
  }
}
