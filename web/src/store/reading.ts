// The reading of whoever looks at a case: the conclusion, kept on the server as it is typed, and its signature.

import { type ReadonlySignal, computed, signal } from "@preact/signals";

import { Problem, ask, send } from "../base/api.ts";
import { t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { type Finding, areSame } from "../model/findings.ts";
import { LONGEST_CONCLUSION, type ListedReading, type Reading as Kept } from "../model/readings.ts";
import { plainText } from "../model/text.ts";
import { announce } from "./announce.ts";
import { isNamed, mayWrite } from "./holder.ts";

/** What the server has not got yet of cases that were left, by path: it is sent again and again, and shown again. */
const UNSENT = new Map<string, Reading>();

/** How long the hand may rest before the conclusion is sent, and before it is sent again, in ms. */
const REST_MS = 500;
const AGAIN_MS = 5000;

/** What is signed: what was shown when the reader was asked. */
export interface Seen {
  readonly conclusion: string;
  readonly findings: readonly Finding[];
}

interface Stored {
  readonly reading: Kept;
  readonly tag: string;
}

export class Reading {
  readonly #path: string;
  /** The findings of the case as they are shown. */
  #findings: ReadonlySignal<readonly Finding[]>;
  /** Who has read the case. */
  readonly all = signal<readonly ListedReading[]>([]);
  readonly #stored = signal<Stored | null>(null);
  /** One's own, as the server has it; null: not known yet, or one has no name. */
  readonly mine = computed(() => this.#stored.value?.reading ?? null);
  readonly isSigned = computed(() => this.mine.value?.state === "signed");
  /** Whether there is a reading to report: something is concluded. */
  readonly isBegun = computed(() => this.conclusion.value.trim() !== "");
  readonly conclusion = signal("");
  /** Whether the server has what was typed. */
  readonly isKept = computed(() => !this.mine.value || this.mine.value.conclusion === plain(this.conclusion.value));
  /** Where the conclusion is. */
  readonly status = signal("");
  /** Whether a signature or a correction is on its way. */
  readonly isBusy = signal(false);
  #timer = 0;
  /** Whether what is stored could not be read, which is said. */
  #isUnread = false;
  #last: Promise<unknown> = Promise.resolve();

  private constructor(path: string, findings: ReadonlySignal<readonly Finding[]>) {
    this.#path = path;
    this.#findings = findings;
  }

  /** The reading of a case that is opened. */
  static of(id: string, findings: ReadonlySignal<readonly Finding[]>): Reading {
    const path = `v1/cases/${id}/readings`;
    const reading = UNSENT.get(path) ?? new Reading(path, findings);
    UNSENT.delete(path);
    reading.#findings = findings;
    addEventListener("beforeunload", reading.#leave);
    document.addEventListener("visibilitychange", reading.#turn);
    return reading;
  }

  /** What was not sent is sent now; without a server, again and again, and whoever closes the page is warned as long. */
  dispose(): void {
    document.removeEventListener("visibilitychange", this.#turn);
    UNSENT.set(this.#path, this);
    this.#sendIn(0);
  }

  get #typed(): string {
    return plain(this.conclusion.peek());
  }

  /** What is shown now, to be signed. */
  get seen(): Seen {
    return { conclusion: this.#typed, findings: this.#findings.peek() };
  }

  /** Reads who has read the case, and one's own reading, if one has a name. */
  async load(): Promise<void> {
    const isRead = await this.#tell(async () => {
      this.all.value = (await ask<{ readonly readings: readonly ListedReading[] }>(this.#path)).readings;
      if (isNamed.peek() && mayWrite.peek() && this.isKept.peek()) await this.#inTurn(() => this.#read());
    });
    if (isRead && this.#isUnread) this.status.value = "";
    this.#isUnread = !isRead;
  }

  /** Keeps what is typed as soon as the hand rests. */
  write(conclusion: string): void {
    this.conclusion.value = conclusion;
    this.#sendIn(REST_MS);
  }

  /** Sends the conclusion, with the findings as they are shown; beside a signed one it waits for a correction. */
  async flush(): Promise<void> {
    clearTimeout(this.#timer);
    try {
      await this.#inTurn(async () => {
        if (!this.isKept.peek() && !this.isSigned.peek()) await this.#keep();
      });
      if (this.isKept.peek()) this.#forget();
    } catch (problem) {
      // Of a case that is deleted nothing is left.
      if (problem instanceof Problem && problem.status === 404) this.#forget();
      throw problem;
    }
  }

  #forget(): void {
    if (UNSENT.get(this.#path) !== this) return;
    UNSENT.delete(this.#path);
    removeEventListener("beforeunload", this.#leave);
  }

  /** Signs what was seen; whether it is signed now. */
  sign(seen: Seen): Promise<boolean> {
    clearTimeout(this.#timer);
    return this.#act(async () => {
      await this.#keep();
      // What another window or another reader wrote was not read by whoever signs.
      const { conclusion, findings } = this.seen;
      if (conclusion !== seen.conclusion || !areSame(findings, seen.findings))
        throw new Problem(412, "reading-changed", "");
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
    return this.#act(() => this.#keep());
  }

  readonly #leave = (event: Event): void => {
    if (this.isKept.peek()) return;
    event.preventDefault();
    this.flush().catch(() => {});
  };

  /** Nothing may be left of a page in the background. */
  readonly #turn = (): void => {
    if (document.hidden) this.flush().catch(() => {});
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
      await this.#read();
      const there = this.mine.peek();
      if (!there || there.state === "signed") throw problem;
      if (there.conclusion !== base && !this.isKept.peek())
        this.conclusion.value = [there.conclusion, this.#typed].filter((text) => text !== "").join("\n\n");
      await this.#put();
    }
  }

  async #put(): Promise<void> {
    const headers = { "if-match": this.#stored.peek()?.tag ?? "", "content-type": "application/json" };
    const sent = this.seen;
    const body = JSON.stringify(sent);
    const keepalive = body.length < 20_000;
    await this.#take(await send(`${this.#path}/mine`, { method: "PUT", headers, body, keepalive }), sent.conclusion);
  }

  /** Takes over what the server has; what was typed after `known` stays. */
  async #take(answer: Response, known = this.mine.peek()?.conclusion ?? ""): Promise<void> {
    const reading = (await answer.json()) as Kept;
    // A proxy that compresses makes a weak tag of a strong one.
    const tag = (answer.headers.get("etag") ?? "").replace(/^W\//, "");
    this.#stored.value = { reading, tag };
    if (this.#typed === known && known !== reading.conclusion) this.conclusion.value = reading.conclusion;
  }
}

const plain = (text: string): string => plainText(text, LONGEST_CONCLUSION);
