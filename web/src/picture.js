// A picture that follows what is wanted: one request at a time, always the latest wish next, never an older answer
// over a newer one. What is written on a picture changes in the same moment as the picture, so that no letter of one
// view ever stands beside another view.

/** How often a busy server (503) is asked again before the page says so. */
const BUSY_TRIES = 5;

export class Picture {
  #frame;
  #image;
  #trouble;
  #load;
  #wish = null;
  #shown = null;
  #running = false;

  /** `load(path)` resolves to a Blob. `frame` holds an `img` and, if it is to say errors, a `.trouble` paragraph. */
  constructor(frame, load) {
    this.#frame = frame;
    this.#image = frame.querySelector("img");
    this.#trouble = frame.querySelector(".trouble");
    this.#load = load;
  }

  /** Shows the picture at `path` as soon as may be; `caption(image)` then writes on it. */
  show(path, caption) {
    this.#wish = { path, caption };
    if (!this.#running && path !== this.#shown) this.#run();
  }

  /** Shows nothing. */
  clear() {
    this.#wish = null;
    this.#put(new Image());
    this.#complain("");
  }

  async #run() {
    this.#running = true;
    this.#frame.classList.add("loading");
    while (this.#wish && this.#wish.path !== this.#shown) {
      const wish = this.#wish;
      try {
        const image = await this.#patiently(wish);
        if (this.#wish) this.#put(image, wish);
      } catch (error) {
        // An answer to a wish that is no longer held is of no interest, an error neither.
        if (wish === this.#wish) {
          this.#complain(error.message);
          break;
        }
      }
    }
    this.#frame.classList.remove("loading");
    this.#running = false;
  }

  async #patiently(wish) {
    for (let attempt = 1; ; attempt += 1) {
      try {
        return await decoded(await this.#load(wish.path));
      } catch (error) {
        if (error.status !== 503 || attempt === BUSY_TRIES || wish !== this.#wish) throw error;
        await new Promise((resolve) => setTimeout(resolve, 1000 * Math.min(error.retryAfter || 1, 5)));
      }
    }
  }

  #put(image, wish) {
    image.id = this.#image.id;
    image.draggable = false;
    this.#image.replaceWith(image);
    this.#image = image;
    this.#shown = wish?.path ?? null;
    this.#frame.dataset.naturalWidth = String(image.naturalWidth);
    wish?.caption(image);
    this.#complain("");
  }

  #complain(message) {
    // A picture that is not the one asked for is not left standing.
    this.#frame.classList.toggle("troubled", message !== "");
    if (message !== "") this.#shown = null;
    if (!this.#trouble) return;
    this.#trouble.textContent = message;
    this.#trouble.hidden = message === "";
  }
}

/** An image element that is ready to be painted. */
async function decoded(blob) {
  const image = new Image();
  const address = URL.createObjectURL(blob);
  try {
    image.src = address;
    await image.decode();
    return image;
  } catch {
    throw new Error("The picture that the server sent cannot be read.");
  } finally {
    URL.revokeObjectURL(address);
  }
}
