// Sending files: a bar, how much is sent in words, and a button that cancels.

import type { UploadProgress } from "../base/api.ts";
import { h, setText } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";

export class Transfer {
  readonly #bar = h("progress", { max: 1, value: 0, hidden: true, "aria-label": t("upload.progress") });
  readonly #sent = h("p", { class: "quiet sent", hidden: true });
  readonly #send: HTMLButtonElement;
  readonly #cancel: HTMLButtonElement;
  readonly parts: readonly HTMLElement[];
  #abort = new AbortController();

  constructor(words: string) {
    this.#send = h("button", { type: "submit", class: "primary" }, words);
    this.#cancel = h("button", { type: "button", hidden: true, click: () => this.#abort.abort() }, t("upload.cancel"));
    this.parts = [h("div", { class: "row" }, this.#send, this.#cancel), this.#bar, this.#sent];
  }

  get isCancelled(): boolean {
    return this.#abort.signal.aborted;
  }

  /** Works with its button off; `work` passes `observe` on, once for each form that it sends. */
  async run<Result>(
    work: (signal: AbortSignal, observe: () => (progress: UploadProgress) => void) => Promise<Result>,
  ): Promise<Result> {
    this.#abort = new AbortController();
    this.#busy(true);
    try {
      return await work(this.#abort.signal, () => this.#teller());
    } finally {
      this.#busy(false);
    }
  }

  /** Tells how much is sent, and when all will be. */
  #teller(): (progress: UploadProgress) => void {
    const begun = performance.now();
    return ({ loaded, total }) => {
      const share = total > 0 ? loaded / total : 0;
      this.#bar.value = share;
      const seconds = share > 0 ? ((performance.now() - begun) / 1000) * (1 / share - 1) : NaN;
      const [sent, all] = [loaded, total].map((bytes) => number(bytes / 1e6, 1));
      const words = t("upload.sent", { sent: sent ?? "", all: all ?? "", share: number(100 * share) });
      const left = share < 1 && seconds >= 1 ? t("upload.left", { seconds: number(Math.ceil(seconds)) }) : "";
      setText(this.#sent, share < 1 ? `${words}${left}` : t("upload.checking"));
    };
  }

  #busy(busy: boolean): void {
    this.#send.disabled = busy;
    for (const element of [this.#cancel, this.#bar, this.#sent]) element.hidden = !busy;
    setText(this.#sent, "");
    this.#bar.value = 0;
  }
}
