// A surface that the server draws: pictures follow the state, small while it moves, full when it rests.

import { mirrored } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { mirrorPlane } from "../model/midsagittal.ts";
import { FollowingPicture, served } from "../base/picture.ts";
import { troubleWords } from "../base/problem-words.ts";
import { pictureSize, renderQuery } from "../model/query.ts";
import type { Vec2 } from "../model/space.ts";
import { type ViewState, isHalved } from "../model/state.ts";
import type { Surface } from "./surface.ts";

const FULL_PIXELS = 1024;
const MOVING_PIXELS = 320;
/** The larger side of a picture that is saved. */
const MOST_PIXELS = 4096;

/** One picture of the pane: the whole, or a half of it. */
interface Half {
  readonly box: HTMLElement;
  readonly picture: FollowingPicture<ViewState>;
}

export interface ServedListener {
  /** A picture of the server is up, in front of the canvas. */
  drawn(state: ViewState): void;
  trouble(words: string): void;
}

export type ServedSurface = Pick<Surface, "draw" | "picture" | "dispose">;

export function createServerSurface(host: HTMLElement, shown: ReadyCase, listener: ServedListener): ServedSurface {
  const complain = (problem: unknown): void => listener.trouble(troubleWords(problem));
  const makeHalf = (side: "whole" | "other"): Half => {
    const box = document.createElement("div");
    box.className = `server-picture ${side}`;
    host.append(box);
    const put = (image: HTMLImageElement, state: ViewState): void => {
      image.alt = "";
      box.replaceChildren(image);
      host.classList.toggle("halved", isHalved(state));
      if (side === "whole") listener.drawn(state);
    };
    return { box, picture: new FollowingPicture<ViewState>({ put, complain }, served) };
  };
  const whole = makeHalf("whole");
  const other = makeHalf("other");

  const path = (state: ViewState, size: Vec2): string => `${shown.id}/render?${renderQuery(state, size)}`;
  const sizeFor = (state: ViewState, most: number): Vec2 => {
    const halves = isHalved(state) ? 2 : 1;
    return pictureSize([host.clientWidth / halves, host.clientHeight], devicePixelRatio, most);
  };
  return {
    draw(state, moving) {
      const size = sizeFor(state, moving ? MOVING_PIXELS : FULL_PIXELS);
      whole.picture.show(path(state, size), state);
      whole.picture.again();
      if (!isHalved(state)) return;
      const across = mirrored(state, mirrorPlane(shown), shown.envelope_sphere);
      other.picture.show(path({ ...state, ...across }, size), state);
      other.picture.again();
    },
    async picture(state, ratio) {
      const size = pictureSize([host.clientWidth / (isHalved(state) ? 2 : 1), host.clientHeight], ratio, MOST_PIXELS);
      const fetched = async (view: ViewState): Promise<HTMLImageElement> => served({ path: path(view, size) });
      const across = mirrored(state, mirrorPlane(shown), shown.envelope_sphere);
      const halves = await Promise.all([
        fetched(state),
        ...(isHalved(state) ? [fetched({ ...state, ...across })] : []),
      ]);
      const canvas = document.createElement("canvas");
      canvas.width = size[0] * halves.length;
      canvas.height = size[1];
      const context = canvas.getContext("2d");
      const [left, right] = halves;
      if (left) context?.drawImage(left, 0, 0);
      context?.scale(-1, 1);
      if (right) context?.drawImage(right, -canvas.width, 0);
      return canvas;
    },
    dispose() {
      for (const { box, picture } of [whole, other]) {
        picture.stop();
        box.remove();
      }
    },
  };
}
