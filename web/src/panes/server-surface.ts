// A surface that the server draws: pictures follow the state, small while it moves, full when it rests.

import { mirrored } from "../model/camera.ts";
import { Problem } from "../base/api.ts";
import type { ReadyCase } from "../model/case.ts";
import { mirrorPlane } from "../model/midsagittal.ts";
import { FollowingPicture } from "../base/picture.ts";
import { pictureSize, renderQuery } from "../model/query.ts";
import type { Vec2 } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import type { Surface, SurfaceOptions } from "./surface.ts";

const FULL_PIXELS = 1024;
const MOVING_PIXELS = 320;

/** One picture of the pane: the whole, or a half of the layout `mirror`. */
interface Half {
  readonly box: HTMLElement;
  readonly picture: FollowingPicture<ViewState>;
}

export function createServerSurface(host: HTMLElement, shown: ReadyCase, options: SurfaceOptions): Surface {
  const complain = (problem: unknown): void => {
    const trouble =
      problem === null ? "" : problem instanceof Problem ? problem.detail || problem.kind : String(problem);
    options.onStatus({ way: "server", fallback: null, trouble });
  };
  const makeHalf = (side: "whole" | "other"): Half => {
    const box = document.createElement("div");
    box.className = `server-picture ${side}`;
    host.append(box);
    const put = (image: HTMLImageElement, state: ViewState): void => {
      image.alt = "";
      box.replaceChildren(image);
      host.classList.toggle("halved", state.layout === "mirror");
      if (side === "whole") options.onDrawn(state);
    };
    return { box, picture: new FollowingPicture<ViewState>({ put, complain }) };
  };
  const whole = makeHalf("whole");
  const other = makeHalf("other");

  const path = (state: ViewState, size: Vec2): string => `${shown.id}/render?${renderQuery(state, size)}`;
  const sizeFor = (state: ViewState, most: number): Vec2 => {
    const halves = state.layout === "mirror" ? 2 : 1;
    return pictureSize([host.clientWidth / halves, host.clientHeight], devicePixelRatio, most);
  };
  return {
    load: async () => {},
    draw(state, moving) {
      const size = sizeFor(state, moving ? MOVING_PIXELS : FULL_PIXELS);
      whole.picture.show(path(state, size), state);
      whole.picture.again();
      if (state.layout !== "mirror") return;
      const across = mirrored(state, mirrorPlane(shown), shown.envelope_sphere);
      other.picture.show(path({ ...state, ...across }, size), state);
      other.picture.again();
    },
    pick: () => null,
    profile: () => null,
    probe: () => null,
    async picture() {
      const canvas = document.createElement("canvas");
      canvas.width = host.clientWidth * devicePixelRatio;
      canvas.height = host.clientHeight * devicePixelRatio;
      const context = canvas.getContext("2d");
      const halved = host.classList.contains("halved");
      const [left, right] = [whole, other].map(({ box }) => box.querySelector("img"));
      const width = halved ? canvas.width / 2 : canvas.width;
      if (left) context?.drawImage(left, 0, 0, width, canvas.height);
      context?.scale(-1, 1);
      if (right && halved) context?.drawImage(right, -canvas.width, 0, width, canvas.height);
      return canvas;
    },
    showTimer() {},
    dispose() {
      for (const { box, picture } of [whole, other]) {
        picture.stop();
        box.remove();
      }
    },
  };
}
