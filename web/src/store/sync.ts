// Keeps on the server, as it is made, what is written about a case. What the server has not got yet stays in the page.

import { type Signal, signal } from "@preact/signals";

import { Problem, send } from "../base/api.ts";
import { t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";

/** How long the hand may rest before a change is sent, and before it is sent again to a server that does not answer, in ms. */
const REST_MS = 500;
export const AGAIN_MS = 5000;
/** How often what others have changed meanwhile is joined and sent again at once. */
const MOST_CONFLICTS = 5;

/** What the server has not got yet of cases that were left, by key: it is sent again and again, and shown again. */
const UNSENT = new Map<string, Sync<unknown>>();

/** What was left under a key, or what is begun; it is attended to until it is left. */
export function resumed<One extends Sync<unknown>>(key: string, begin: () => One): One {
  const one = (UNSENT.get(key) as One | undefined) ?? begin();
  UNSENT.delete(key);
  one.attend();
  return one;
}

/** What the server answers, and its version. */
export interface Stored<Value> {
  readonly value: Value;
  /** Empty as long as nothing has been read. */
  readonly tag: string;
}

export abstract class Sync<Value> {
  protected readonly path: string;
  /** What is here, by whomever. */
  readonly value: Signal<Value>;
  /** Where it is, or why the server has not got it. */
  readonly status = signal("");
  /** Whether all that is stored is here. */
  readonly isRead = signal(false);
  /** What the server has, as far as the page knows. */
  protected readonly stored: Signal<Stored<Value>>;
  #timer = 0;
  #isSending = false;
  #retry = 0;
  #isLeft = false;
  /** Whether what is stored could not be read, which is said. */
  #isUnread = false;
  /** The last of the requests, which come one after another: no answer is older than the one before. */
  #last: Promise<unknown> = Promise.resolve();

  constructor(path: string, empty: Value) {
    this.path = path;
    this.value = signal(empty);
    this.stored = signal({ value: empty, tag: "" });
  }

  protected abstract areSame(one: Value, other: Value): boolean;
  /** What is here and what is there as one; both may have changed since `base`. */
  protected abstract joined(base: Value, here: Value, there: Value): Value;
  protected abstract bodyOf(value: Value): object;
  protected abstract valueOf(answer: unknown): Value;

  /** What it is left under. */
  protected get key(): string {
    return this.path;
  }

  /** Whether changes are sent without being asked for. */
  protected get isOpen(): boolean {
    return true;
  }

  get isKept(): boolean {
    return !this.#isSending && this.areSame(this.value.peek(), this.stored.peek().value);
  }

  /** Whether nothing is lost if the page is closed. */
  protected get isSafe(): boolean {
    return this.isKept;
  }

  attend(): void {
    this.#isLeft = false;
    addEventListener("beforeunload", this.#leave);
    document.addEventListener("visibilitychange", this.#turn);
  }

  /** What was not sent is sent now; whoever closes the page is warned as long as the server has not got all of it. */
  dispose(): void {
    this.#isLeft = true;
    clearTimeout(this.#retry);
    document.removeEventListener("visibilitychange", this.#turn);
    UNSENT.set(this.key, this);
    this.#sendIn(0);
  }

  /**
   * Reads what is stored, joins it with what this page has not sent yet, and sends that; whether it could be read. It is read again as long as
   * the server does not answer.
   */
  async load(): Promise<boolean> {
    clearTimeout(this.#retry);
    try {
      await this.readAll();
      if (this.#isUnread) this.status.value = "";
      this.#isUnread = false;
    } catch (problem) {
      this.#isUnread = true;
      this.status.value = problemWords(problem);
      if (!this.#isLeft && !isFinal(problem))
        this.#retry = setTimeout(() => void this.load(), AGAIN_MS) as unknown as number;
    }
    if (!this.isKept) this.#sendIn(0);
    return !this.#isUnread;
  }

  /** Shows a change at once, and sends it when the hand rests. */
  change(value: Value): void {
    this.value.value = value;
    this.#sendIn(REST_MS);
  }

  /** Sends what is not sent yet now. Resolves when the server has it as it is then; rejects if it cannot have it. */
  async flush(): Promise<void> {
    // What changes while it is sent needs another turn.
    do await this.push(false);
    while (!this.isKept && this.isOpen);
  }

  protected readAll(): Promise<void> {
    return this.inTurn(() => this.read());
  }

  protected async read(): Promise<void> {
    const answer = await send(this.path, { cache: "no-cache" });
    // Nobody has changed anything.
    if (this.stored.peek().tag === "" || tagOf(answer) !== this.stored.peek().tag) this.adopt(await this.heard(answer));
    this.isRead.value = true;
  }

  protected async heard(answer: Response): Promise<Stored<Value>> {
    return { value: this.valueOf(await answer.json()), tag: tagOf(answer) };
  }

  /** Takes over what is stored now; what has been changed here since stays. */
  protected adopt(stored: Stored<Value>): void {
    const base = this.stored.peek().value;
    this.stored.value = stored;
    this.value.value = this.joined(base, this.value.peek(), stored.value);
  }

  protected async put(body: string | Blob, type = "application/json"): Promise<Stored<Value>> {
    const headers = { "if-match": this.stored.peek().tag, "content-type": type };
    const keepalive = typeof body === "string" && body.length < 20_000;
    return this.heard(await send(this.path, { method: "PUT", headers, body, keepalive }));
  }

  protected inTurn<Done>(work: () => Promise<Done>): Promise<Done> {
    const turn = this.#last.then(work);
    this.#last = turn.catch(() => {});
    return turn;
  }

  /** Asks for a change; where somebody else was faster, again, with what is there now. */
  protected async insist(ask: () => Promise<void>): Promise<void> {
    // A change must name what it changes.
    if (this.stored.peek().tag === "") await this.read();
    for (let round = 1; ; round += 1) {
      try {
        return await ask();
      } catch (problem) {
        if (!isConflict(problem) || round === MOST_CONFLICTS) throw problem;
        await this.read();
        if (!this.isOpen) throw problem;
      }
    }
  }

  /** Sends what is here, if the server has not got it, or in any case. */
  protected push(always: boolean): Promise<void> {
    clearTimeout(this.#timer);
    return this.inTurn(async () => {
      if (always || (!this.isKept && this.isOpen)) await this.#send();
      if (this.isSafe) this.#forget();
    });
  }

  async #send(): Promise<void> {
    this.#isSending = true;
    try {
      await this.insist(async () => {
        const sent = this.value.peek();
        const stored = await this.put(JSON.stringify(this.bodyOf(sent)));
        // The server has what was sent, and may add to it.
        this.stored.value = { ...this.stored.peek(), value: sent };
        this.adopt(stored);
      });
    } catch (problem) {
      const isRefused = isFinal(problem);
      this.status.value = t(isRefused ? "findings.refused" : "findings.unsent", { why: problemWords(problem) });
      if (!isRefused) this.#sendIn(AGAIN_MS);
      // Of a case that is deleted nothing is left.
      if (problem instanceof Problem && problem.status === 404) this.#forget();
      throw problem;
    } finally {
      this.#isSending = false;
    }
    if (this.isKept) this.status.value = t("findings.kept");
    else this.#sendIn(REST_MS);
  }

  #forget(): void {
    if (UNSENT.get(this.key) !== this) return;
    UNSENT.delete(this.key);
    removeEventListener("beforeunload", this.#leave);
  }

  #sendIn(ms: number): void {
    clearTimeout(this.#timer);
    // What goes wrong is told as it happens.
    this.#timer = setTimeout(() => void this.push(false).catch(() => {}), ms) as unknown as number;
  }

  readonly #leave = (event: Event): void => {
    if (this.isSafe) return;
    event.preventDefault();
    // It may be there before the reader has answered.
    this.flush().catch(() => {});
  };

  readonly #turn = (): void => {
    if (!document.hidden) void this.load();
    // Nothing may be left of a page in the background.
    else this.flush().catch(() => {});
  };
}

/** Whether somebody else has changed it, or the server was not told what this page knows. */
const isConflict = (problem: unknown): boolean =>
  problem instanceof Problem && (problem.status === 412 || problem.status === 428);

/** Whether the server will never accept it as it is. */
export const isFinal = (problem: unknown): boolean =>
  problem instanceof Problem &&
  problem.status >= 400 &&
  problem.status < 500 &&
  !isConflict(problem) &&
  ![401, 408, 409, 429].includes(problem.status);

/** The version of an answer. A proxy that compresses makes a weak tag of a strong one, which names no version any more. */
const tagOf = (answer: Response): string => (answer.headers.get("etag") ?? "").replace(/^W\//, "");
