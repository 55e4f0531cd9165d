// Keeps the findings of a case on the server as they are made. What the server has not got yet stays in the page.

import { signal } from "@preact/signals";

import { Problem, send } from "../base/api.ts";
import { type Finding, areSame, merged } from "../model/findings.ts";

/** How long the hand may rest before a change is sent, and before it is sent again to a server that does not answer, in ms. */
const REST_MS = 500;
const AGAIN_MS = 5000;
/** How often a list that others have changed meanwhile is joined and sent again at once. */
const MOST_CONFLICTS = 5;

/** Where the findings are: on the server, on their way, or in the page alone; `refused` where the server will not take them. */
export type Kept = "kept" | "sending" | "unsent" | "refused";

/** What the server answers, and its version. */
interface Stored {
  readonly list: readonly Finding[];
  /** Empty as long as nothing has been read. */
  readonly tag: string;
}

const JSON_TYPE = "application/json";

export class FindingsSync {
  readonly #id: string;
  /** What is here, by whomever. */
  readonly list = signal<readonly Finding[]>([]);
  /** Where it is; `problem` is why the server has not got it. */
  readonly kept = signal<{ readonly kept: Kept; readonly problem: unknown } | null>(null);
  /** Somebody else has changed the same findings: so many are there twice since then. */
  readonly doubled = signal<{ readonly count: number } | null>(null);
  /** What a finding is known by on the page, if it is not its id: what is being written about goes on in its own. */
  readonly #keys = new Map<string, string>();
  /** What the server has, as far as the page knows. */
  #stored: Stored = { list: [], tag: "" };
  #timer = 0;
  #isSending = false;
  /** The last of the requests, which come one after another: no answer is older than the one before. */
  #last: Promise<unknown> = Promise.resolve();

  constructor(id: string) {
    this.#id = id;
  }

  get #list(): readonly Finding[] {
    return this.list.peek();
  }

  /** What a finding is known by on the page, also where it has got another id. */
  keyOf({ id }: Pick<Finding, "id">): string {
    return this.#keys.get(id) ?? id;
  }

  get isKept(): boolean {
    return !this.#isSending && areSame(this.#list, this.#stored.list);
  }

  /** Reads what is stored, joins it with what this page has not sent yet, and sends that. */
  async load(): Promise<void> {
    await this.#inTurn(() => this.#read());
    if (!this.isKept) this.#sendIn(0);
  }

  /** Reads what others have changed; what is changed here is joined with that when it is sent. */
  async look(): Promise<void> {
    if (this.isKept && this.#stored.tag !== "") await this.#inTurn(() => this.#read());
  }

  /** Shows a changed list at once, and sends it when the hand rests. */
  change(list: readonly Finding[]): void {
    this.list.value = list;
    this.#sendIn(REST_MS);
  }

  /** Sends what is not sent yet now. Resolves when the server has the list as it is then; rejects if it cannot have it. */
  async flush(): Promise<void> {
    // What changes while a list is sent needs another turn.
    do await this.#send();
    while (!this.isKept);
  }

  /** Sends what a file has in the place of the list, and takes what is made of the answer as the list. */
  async take(
    body: string | Blob,
    type: string,
    made: (stored: readonly Finding[]) => readonly Finding[],
  ): Promise<void> {
    await this.flush();
    await this.#inTurn(async () => {
      const before = this.#list;
      const stored = await this.#put(body, type);
      this.#stored = stored;
      // What has been changed here meanwhile stays.
      this.change(merged(before, this.#list, made(stored.list)).list);
    });
    await this.flush();
  }

  /** Adds the findings of another case, unconfirmed. */
  async takeOver(other: string): Promise<void> {
    await this.flush();
    const ask = async (): Promise<void> => {
      const headers = { "if-match": this.#stored.tag };
      this.#take(await readAnswer(await send(`${this.#address}/from/${other}`, { method: "POST", headers })));
    };
    await this.#inTurn(() => this.#insist(ask));
  }

  get #address(): string {
    return `v1/cases/${this.#id}/findings`;
  }

  #inTurn<Done>(work: () => Promise<Done>): Promise<Done> {
    const turn = this.#last.then(work);
    this.#last = turn.catch(() => {});
    return turn;
  }

  #sendIn(ms: number): void {
    clearTimeout(this.#timer);
    // What goes wrong is told as it happens.
    this.#timer = setTimeout(() => void this.#send().catch(() => {}), ms) as unknown as number;
  }

  #send(): Promise<void> {
    clearTimeout(this.#timer);
    return this.#inTurn(async () => {
      if (this.isKept) return;
      this.#isSending = true;
      this.kept.value = { kept: "sending", problem: null };
      try {
        await this.#sendJoined();
      } catch (problem) {
        this.#isSending = false;
        const isRefused = isFinal(problem);
        this.kept.value = { kept: isRefused ? "refused" : "unsent", problem };
        if (!isRefused) this.#sendIn(AGAIN_MS);
        throw problem;
      }
      this.#isSending = false;
      if (this.isKept) this.kept.value = { kept: "kept", problem: null };
      else this.#sendIn(REST_MS);
    });
  }

  /** Sends the list; where another reader was faster, what is there now is joined with what is here, and sent. */
  #sendJoined(): Promise<void> {
    return this.#insist(async () => {
      const sent = this.#list;
      const stored = await this.#put(JSON.stringify({ findings: sent }), JSON_TYPE);
      // The server has what was sent, and adds sides and times.
      this.#stored = { ...this.#stored, list: sent };
      this.#take(stored);
    });
  }

  /** Asks for a change; where another reader was faster, again, with what is there now. */
  async #insist(ask: () => Promise<void>): Promise<void> {
    // A change must name what it changes.
    if (this.#stored.tag === "") await this.#read();
    for (let round = 1; ; round += 1) {
      try {
        return await ask();
      } catch (problem) {
        if (!isConflict(problem) || round === MOST_CONFLICTS) throw problem;
        await this.#read();
      }
    }
  }

  async #read(): Promise<void> {
    const answer = await send(this.#address, { cache: "no-cache" });
    // Nobody has changed anything.
    if (this.#stored.tag !== "" && tagOf(answer) === this.#stored.tag) return;
    this.#take(await readAnswer(answer));
  }

  async #put(body: string | Blob, type: string): Promise<Stored> {
    const headers = { "if-match": this.#stored.tag, "content-type": type };
    const keepalive = typeof body === "string" && body.length < 20_000;
    return readAnswer(await send(this.#address, { method: "PUT", headers, body, keepalive }));
  }

  /** Takes over what is stored now; what has been changed here since stays. */
  #take(stored: Stored): void {
    const { list, moved } = merged(this.#stored.list, this.#list, stored.list);
    this.#stored = stored;
    for (const [id, own] of moved) {
      this.#keys.set(own, this.keyOf({ id }));
      this.#keys.set(id, own);
    }
    this.list.value = list;
    if (moved.length > 0) this.doubled.value = { count: moved.length };
  }
}

/** Whether somebody else has changed the findings, or the server was not told which ones this page knows. */
const isConflict = (problem: unknown): boolean =>
  problem instanceof Problem && (problem.status === 412 || problem.status === 428);

/** Whether the server will never accept the list as it is. */
const isFinal = (problem: unknown): boolean =>
  problem instanceof Problem &&
  problem.status >= 400 &&
  problem.status < 500 &&
  !isConflict(problem) &&
  ![401, 408, 409, 429].includes(problem.status);

/** The version of an answer. A proxy that compresses makes a weak tag of a strong one, which names no version any more. */
const tagOf = (answer: Response): string => (answer.headers.get("etag") ?? "").replace(/^W\//, "");

async function readAnswer(answer: Response): Promise<Stored> {
  const { findings } = (await answer.json()) as { readonly findings: readonly Finding[] };
  return { list: findings, tag: tagOf(answer) };
}
