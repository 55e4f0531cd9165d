// The reading of whoever looks at a case: the conclusion, kept on the server as it is typed, and its signature.

import { type ReadonlySignal, computed, signal } from "@preact/signals";

import { Problem, ask, send } from "../base/api.ts";
import { t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { Finding } from "../model/findings.ts";
import { LONGEST_CONCLUSION, type ListedReading, type Reading as Kept } from "../model/readings.ts";
import { plainText } from "../model/text.ts";
import { announce } from "./announce.ts";
import { isNamed, mayWrite } from "./holder.ts";

/** How long the hand may rest before the conclusion is sent, and before it is sent again, in ms. */
const REST_MS = 500;
const AGAIN_MS = 5000;

interface Stored {
  readonly reading: Kept;
  readonly tag: string;
}

export class Reading {
  readonly #path: string;
  /** The findings of the case as they are shown. */
  readonly #findings: ReadonlySignal<readonly Finding[]>;
  /** Who has read the case. */
  readonly all = signal<readonly ListedReading[]>([]);
  readonly #stored = signal<Stored | null>(null);
  /** One's own, as the server has it; null: not known yet, or one has no name. */
  readonly mine = computed(() => this.#stored.value?.reading ?? null);
  readonly isSigned = computed(() => this.mine.value?.state === "signed");
  /** Whether there is a reading to report: something is concluded. */
  readonly isBegun = computed(() => this.conclusion.value.trim() !== "");
  readonly conclusion = signal("");
  /** Where the conclusion is. */
  readonly status = signal("");
  /** Whether a signature or a correction is on its way. */
  readonly isBusy = signal(false);
  #timer = 0;
  /** Whether what is stored could not be read, which is said. */
  #isUnread = false;
  #last: Promise<unknown> = Promise.resolve();

  constructor(id: string, findings: ReadonlySignal<readonly Finding[]>) {
    this.#path = `v1/cases/${id}/readings`;
    this.#findings = findings;
    addEventListener("beforeunload", this.#leave);
  }

  /** What was not sent is sent now; without a server, again and again, and whoever closes the page is warned as long. */
  dispose(): void {
    this.flush().then(
      () => removeEventListener("beforeunload", this.#leave),
      () => {},
    );
  }

  /** Whether the server has what was typed. */
  get isKept(): boolean {
    const mine = this.mine.peek();
    return !mine || mine.state === "signed" || mine.conclusion === this.#typed;
  }

  get #typed(): string {
    return plainText(this.conclusion.peek(), LONGEST_CONCLUSION);
  }

  /** Reads who has read the case, and one's own reading, if one has a name. */
  async load(): Promise<void> {
    const isRead = await this.#tell(async () => {
      this.all.value = (await ask<{ readonly readings: readonly ListedReading[] }>(this.#path)).readings;
      if (isNamed.peek() && mayWrite.peek() && this.isKept) await this.#inTurn(() => this.#read());
    });
    if (isRead && this.#isUnread) this.status.value = "";
    this.#isUnread = !isRead;
  }

  /** Keeps what is typed as soon as the hand rests. */
  write(conclusion: string): void {
    this.conclusion.value = conclusion;
    this.#sendIn(REST_MS);
  }

  /** Sends the conclusion, with the findings as they are shown. Rejects if the server cannot have it. */
  async flush(): Promise<void> {
    clearTimeout(this.#timer);
    await this.#inTurn(async () => {
      if (!this.isKept) await this.#keep();
    });
  }

  /** Signs the conclusion with the findings as they are shown; whether it is signed now. */
  sign(): Promise<boolean> {
    clearTimeout(this.#timer);
    return this.#act(async () => {
      const seen = this.#typed;
      await this.#keep();
      // What another window wrote was not read by whoever signs.
      if (this.#typed !== seen) throw new Problem(412, "reading-changed", "");
      const headers = { "if-match": this.#stored.peek()?.tag ?? "" };
      await this.#take(await send(`${this.#path}/mine/signature`, { method: "POST", headers }));
      announce(t("reading.done"));
    });
  }

  /** Whose reading a report is of, once the server has it with the findings as they are shown; null: nothing is concluded. */
  async reported(): Promise<string | null> {
    const mine = this.mine.peek();
    if (!mine || !this.isBegun.peek()) return null;
    if (mine.state === "open") await this.#inTurn(() => this.#keep());
    return mine.reader;
  }

  /** Begins the next version of what is signed. */
  correct(): Promise<boolean> {
    return this.#act(() => this.#put());
  }

  readonly #leave = (event: Event): void => {
    if (this.isKept) return;
    event.preventDefault();
    this.flush().catch(() => {});
  };

  #act(work: () => Promise<void>): Promise<boolean> {
    this.isBusy.value = true;
    const done = this.#tell(() => this.#inTurn(work));
    return done.finally(() => {
      this.isBusy.value = false;
      void this.load();
    });
  }

  /** Does something, or says why it cannot be done. */
  async #tell(work: () => Promise<void>): Promise<boolean> {
    try {
      await work();
      return true;
    } catch (problem) {
      this.status.value = problemWords(problem);
      return false;
    }
  }

  #inTurn<Done>(work: () => Promise<Done>): Promise<Done> {
    const turn = this.#last.then(work);
    this.#last = turn.catch(() => {});
    return turn;
  }

  #sendIn(ms: number): void {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => void this.flush().catch(() => {}), ms) as unknown as number;
  }

  async #read(): Promise<void> {
    await this.#take(await send(`${this.#path}/mine`, { cache: "no-cache" }));
  }

  async #keep(): Promise<void> {
    try {
      await this.#insist();
      this.status.value = t("findings.kept");
    } catch (problem) {
      const isAway = !(problem instanceof Problem) || problem.status === 0 || problem.status >= 429;
      this.status.value = t("findings.unsent", { why: problemWords(problem) });
      if (isAway) this.#sendIn(AGAIN_MS);
      throw problem;
    }
  }

  /** Sends the conclusion; where another window was faster, what is there now stands before what was typed here. */
  async #insist(): Promise<void> {
    if (!this.#stored.peek()) await this.#read();
    const base = this.mine.peek()?.conclusion;
    try {
      await this.#put();
    } catch (problem) {
      if (!(problem instanceof Problem) || problem.status !== 412) throw problem;
      const typed = this.#typed;
      await this.#read();
      const there = this.mine.peek();
      if (!there || there.state === "signed") throw problem;
      const both = [there.conclusion, typed].filter((text) => text !== "").join("\n\n");
      this.conclusion.value = there.conclusion === base || there.conclusion === typed ? typed : both;
      await this.#put();
    }
  }

  async #put(): Promise<void> {
    const headers = { "if-match": this.#stored.peek()?.tag ?? "", "content-type": "application/json" };
    const body = JSON.stringify({ conclusion: this.#typed, findings: this.#findings.peek() });
    await this.#take(await send(`${this.#path}/mine`, { method: "PUT", headers, body }));
  }

  /** Takes over what the server has; what was typed since stays. */
  async #take(answer: Response): Promise<void> {
    const before = this.mine.peek();
    const isTyped = before !== null && before.state === "open" && this.#typed !== before.conclusion;
    const reading = (await answer.json()) as Kept;
    // A proxy that compresses makes a weak tag of a strong one.
    const tag = (answer.headers.get("etag") ?? "").replace(/^W\//, "");
    this.#stored.value = { reading, tag };
    if (!isTyped || reading.state === "signed") this.conclusion.value = reading.conclusion;
  }
}
