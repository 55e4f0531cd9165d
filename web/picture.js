// A picture that follows what is wanted: one request at a time, always the latest wish next, never an older answer
// over a newer one.

/** How often a busy server (503) is asked again before the page says so. */
const BUSY_TRIES = 5;

export class Picture {
  #frame;
  #image;
  #trouble;
  #load;
  #wanted = null;
  #shown = null;
  #running = false;
  #address = null;

  /** `load(wish)` resolves to a Blob. `frame` holds an `img` and a `.trouble` paragraph, if it has one. */
  constructor(frame, load) {
    this.#frame = frame;
    this.#image = frame.querySelector("img");
    this.#trouble = frame.querySelector(".trouble");
    this.#load = load;
  }

  /** Shows `wish` (a string) as soon as may be; null shows nothing. */
  show(wish) {
    this.#wanted = wish;
    if (wish === null) this.#put(null, null);
    else if (!this.#running && wish !== this.#shown) this.#run();
  }

  async #run() {
    this.#running = true;
    this.#frame.classList.add("loading");
    while (this.#wanted !== null && this.#wanted !== this.#shown) {
      const wish = this.#wanted;
      try {
        const blob = await this.#patiently(wish);
        if (this.#wanted !== null) await this.#put(blob, wish);
      } catch (error) {
        // An answer to a wish that is no longer held is of no interest, an error neither.
        if (wish === this.#wanted) {
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
        return await this.#load(wish);
      } catch (error) {
        if (error.status !== 503 || attempt === BUSY_TRIES || wish !== this.#wanted) throw error;
        await new Promise((resolve) => setTimeout(resolve, 1000 * Math.min(error.retryAfter || 1, 5)));
      }
    }
  }

  async #put(blob, wish) {
    const old = this.#address;
    this.#address = blob && URL.createObjectURL(blob);
    this.#shown = wish;
    this.#complain("");
    if (this.#address) {
      this.#image.src = this.#address;
      await this.#image.decode();
      this.#frame.dataset.naturalWidth = String(this.#image.naturalWidth);
    } else {
      this.#image.removeAttribute("src");
      delete this.#frame.dataset.naturalWidth;
    }
    if (old) URL.revokeObjectURL(old);
  }

  #complain(message) {
    this.#frame.classList.toggle("troubled", message !== "");
    if (!this.#trouble) return;
    this.#trouble.textContent = message;
    this.#trouble.hidden = message === "";
  }
}
