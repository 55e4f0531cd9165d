// The lines above the picture: what went wrong, who draws, and how far the loading is.

import { h, iconButton, setText, tell } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { troubleWords } from "../base/problem-words.ts";
import type { Fallback, LoadProgress } from "../panes/surface.ts";

/** So many parts of an address are named, and so much of each. */
const MOST_UNREAD = 5;
const LONGEST_UNREAD = 40;

interface NoticesListener {
  cancelLoad(): void;
  loadAgain(): void;
}

export class Notices {
  readonly element: HTMLElement;
  readonly #fallback = h("p", { class: "notice-line", role: "status", hidden: true });
  readonly #trouble = h("p", { class: "notice-line bad", role: "alert", hidden: true });
  readonly #remark: HTMLElement;
  readonly #remarkText = h("span", {});
  /** How far the loading is: over the picture, which it does not move. */
  readonly loading: HTMLElement;
  readonly #text = h("span", {});
  readonly #bar = h("progress", { max: 1, "aria-label": t("load.label") });
  readonly #cancel: HTMLButtonElement;
  readonly #again: HTMLButtonElement;

  constructor(listener: NoticesListener) {
    const button = (name: string, words: string, click: () => void): HTMLButtonElement =>
      h("button", { class: name, click }, words);
    this.#cancel = button("cancel-load", t("load.cancel"), () => listener.cancelLoad());
    this.#again = button("load-again", t("load.again"), () => listener.loadAgain());
    this.loading = h("div", { class: "loading-line", hidden: true }, this.#text, this.#bar, this.#cancel, this.#again);
    const dismiss = iconButton("close", t("notice.dismiss"), () => this.remark(""));
    this.#remark = h("div", { class: "notice-line remark", role: "status", hidden: true }, this.#remarkText, dismiss);
    this.element = h("div", { class: "notices" }, this.#trouble, this.#fallback, this.#remark);
  }

  complain(problem: unknown): void {
    this.trouble(troubleWords(problem));
  }

  /** Empty words: all is well. */
  trouble(words: string): void {
    tell(this.#trouble, words);
  }

  fallback(fallback: Fallback | null): void {
    tell(this.#fallback, fallback ? t(`fallback.${fallback}`) : "");
  }

  /** Names the parts of an address that could not be used. */
  unread(parts: readonly string[]): void {
    const named = parts.slice(0, MOST_UNREAD).map((part) => `“${part.slice(0, LONGEST_UNREAD)}”`);
    this.remark(named.length > 0 ? t("address.unread", { parts: named.join(", ") }) : "");
  }

  /** Something to know, which can be dismissed. Empty words: nothing. */
  remark(words: string): void {
    setText(this.#remarkText, words);
    this.#remark.hidden = words === "";
  }

  begin(): void {
    this.#showBar(true);
  }

  progress({ stage, loaded, total }: LoadProgress): void {
    this.loading.hidden = false;
    // A full bar that waits would say that it is over.
    const isWaiting = stage === "ready" || total === 0;
    if (isWaiting) this.#bar.removeAttribute("value");
    else this.#bar.value = Math.min(loaded / total, 0.99);
    const megabytes = (bytes: number): string => number(bytes / 1e6, 1);
    const values = { loaded: megabytes(loaded), total: megabytes(total) };
    setText(this.#text, t(`load.${stage}`) + (isWaiting ? "" : t("load.bytes", values)));
  }

  end(): void {
    this.loading.hidden = true;
  }

  cancelled(): void {
    this.#showBar(false);
    setText(this.#text, t("load.cancelled"));
    this.loading.hidden = false;
    // The focus was on the button that is gone.
    if (document.activeElement === document.body) this.#again.focus();
  }

  #showBar(isUnderWay: boolean): void {
    for (const element of [this.#bar, this.#cancel]) element.hidden = !isUnderWay;
    this.#again.hidden = isUnderWay;
  }
}
