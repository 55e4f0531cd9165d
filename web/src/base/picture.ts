// A picture that follows what is wanted: one request at a time, always the latest wish next, never an older answer
// over a newer one. What is written on a picture changes in the same moment as the picture.

import { Problem, getPicture } from "./api.ts";
import { wait } from "./patience.ts";

/** How often a server that is busy, or still makes the maps, is asked again before that is an error. */
const BUSY_TRIES = 5;

/** A picture that is wanted, and what it shows. */
export interface Wish<About> {
  readonly path: string;
  readonly about: About;
}

interface PictureListener<About, Picture> {
  /** Puts a picture up, with what was given beside its path. */
  put(picture: Picture, about: About): void;
  /** Why the latest picture cannot be loaded; null if it was. */
  complain(problem: unknown): void;
}

export const served = async ({ path }: { readonly path: string }): Promise<HTMLImageElement> =>
  decoded(await getPicture(path));

export class FollowingPicture<About, Picture = HTMLImageElement> {
  #wish: Wish<About> | null = null;
  #shown: string | null = null;
  #running = false;
  readonly #listener: PictureListener<About, Picture>;
  readonly #load: (wish: Wish<About>) => Promise<Picture>;

  constructor(listener: PictureListener<About, Picture>, load: (wish: Wish<About>) => Promise<Picture>) {
    this.#listener = listener;
    this.#load = load;
  }

  /** Shows the picture at `path` as soon as may be, also after a failed request; whether it is up already. */
  show(path: string, about: About): boolean {
    this.#wish = { path, about };
    const isUp = path === this.#shown;
    if (!this.#running && !isUp) void this.#run();
    return isUp;
  }

  /** Wants nothing any more. */
  stop(): void {
    this.#wish = null;
  }

  async #run(): Promise<void> {
    this.#running = true;
    while (this.#wish && this.#wish.path !== this.#shown) {
      const wish: Wish<About> = this.#wish;
      try {
        const picture = await this.#patiently(wish);
        // One that is wanted no more is shown all the same, as long as anything is: the picture follows.
        if (!this.#wish) break;
        this.#shown = wish.path;
        this.#listener.put(picture, wish.about);
        this.#listener.complain(null);
      } catch (error) {
        if (wish === this.#wish) {
          this.#shown = null;
          this.#listener.complain(error);
          break;
        }
      }
    }
    this.#running = false;
  }

  async #patiently(wish: Wish<About>): Promise<Picture> {
    for (let attempt = 1; ; attempt += 1) {
      try {
        return await this.#load(wish);
      } catch (error) {
        const busy = error instanceof Problem && (error.status === 503 || error.kind === "layer-not-ready");
        if (!busy || attempt === BUSY_TRIES || wish !== this.#wish) throw error;
        await wait(1000 * Math.min(error.retryAfter || 1, 5));
      }
    }
  }
}

/** An image element that is ready to be painted; until it has words, it says nothing. */
export async function decoded(blob: Blob): Promise<HTMLImageElement> {
  const image = new Image();
  const address = URL.createObjectURL(blob);
  try {
    image.src = address;
    await image.decode();
    image.draggable = false;
    image.alt = "";
    return image;
  } catch {
    throw new Problem(0, "picture-unreadable", "");
  } finally {
    URL.revokeObjectURL(address);
  }
}
