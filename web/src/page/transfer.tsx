// Sending files: a bar, how much is sent in words, and a button that cancels.

import { signal } from "@preact/signals";
import { useMemo } from "preact/hooks";

import type { Observe } from "../base/api.ts";
import { number, t } from "../base/i18n.ts";

export class Sending {
  readonly isBusy = signal(false);
  readonly share = signal(0);
  readonly words = signal("");
  #abort = new AbortController();

  get isCancelled(): boolean {
    return this.#abort.signal.aborted;
  }

  cancel(): void {
    this.#abort.abort();
  }

  /** Works with its button off; `work` passes `observe` on, once for each form that it sends. */
  async run<Result>(work: (signal: AbortSignal, observe: () => Observe) => Promise<Result>): Promise<Result> {
    this.#abort = new AbortController();
    this.isBusy.value = true;
    try {
      return await work(this.#abort.signal, () => this.#teller());
    } finally {
      this.isBusy.value = false;
      this.share.value = 0;
      this.words.value = "";
    }
  }

  /** Tells how much is sent, and when all will be. */
  #teller(): Observe {
    const begun = performance.now();
    return ({ loaded, total }) => {
      const share = total > 0 ? loaded / total : 0;
      this.share.value = share;
      const seconds = share > 0 ? ((performance.now() - begun) / 1000) * (1 / share - 1) : NaN;
      const [sent, all] = [loaded, total].map((bytes) => number(bytes / 1e6, 1));
      const words = t("upload.sent", { sent, all, share: number(100 * share) });
      const left = share < 1 && seconds >= 1 ? t("upload.left", { seconds: number(Math.ceil(seconds)) }) : "";
      this.words.value = share < 1 ? `${words}${left}` : t("upload.checking");
    };
  }
}

export const useTransfer = (): Sending => useMemo(() => new Sending(), []);

/** The buttons and the bar of a form that sends files; `words` are those of its button. */
export function Transfer({ transfer, words }: { readonly transfer: Sending; readonly words: string }) {
  const isBusy = transfer.isBusy.value;
  return (
    <>
      <div class="row">
        <button type="submit" class="primary" disabled={isBusy}>
          {words}
        </button>
        <button type="button" hidden={!isBusy} onClick={() => transfer.cancel()}>
          {t("upload.cancel")}
        </button>
      </div>
      <progress max={1} value={transfer.share.value} hidden={!isBusy} aria-label={t("upload.progress")} />
      <p class="quiet sent" hidden={!isBusy}>
        {transfer.words.value}
      </p>
    </>
  );
}
