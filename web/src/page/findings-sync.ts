// Keeps the findings of a case on the server as they are made. What the server has not got yet stays in the page.

import { Problem, send } from "../base/api.ts";
import { type Finding, areSame, merged } from "../model/findings.ts";

/** How long the hand may rest before a change is sent, and before it is sent again to a server that does not answer, in ms. */
const REST_MS = 500;
const AGAIN_MS = 5000;

/** Where the findings are: on the server, on their way, or in the page alone; `refused` where the server will not take them. */
export type Kept = "kept" | "sending" | "unsent" | "refused";

export interface FindingsHost {
  readonly id: string;
  /** The list has changed, by whomever. */
  shown(list: readonly Finding[]): void;
  /** `problem` is why the server has not got them. */
  kept(kept: Kept, problem: unknown): void;
  /** Somebody else has changed the same findings: so many are there twice now. */
  doubled(count: number): void;
}

/** What the server answers, and its version. */
interface Stored {
  readonly list: readonly Finding[];
  readonly tag: string;
}

export class FindingsSync {
  readonly #host: FindingsHost;
  /** What the server has, as far as the page knows. */
  #stored: Stored = { list: [], tag: "" };
  #list: readonly Finding[] = [];
  #timer = 0;
  #isSending = false;

  constructor(host: FindingsHost) {
    this.#host = host;
  }

  get list(): readonly Finding[] {
    return this.#list;
  }

  get isKept(): boolean {
    return !this.#isSending && areSame(this.#list, this.#stored.list);
  }

  /** Reads what is stored, and joins it with what this page has not sent yet. */
  async load(): Promise<void> {
    const answer = await send(this.#address, { cache: "no-cache" });
    this.#take(await readAnswer(answer));
  }

  /** Shows a changed list at once, and sends it when the hand rests. */
  change(list: readonly Finding[]): void {
    this.#list = list;
    this.#host.shown(list);
    this.#sendIn(REST_MS);
  }

  /** Sends what is not sent yet now, because the page turns to something else. */
  flush(): void {
    clearTimeout(this.#timer);
    if (!this.isKept) void this.#send();
  }

  get #address(): string {
    return `v1/cases/${this.#host.id}/findings`;
  }

  #sendIn(ms: number): void {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => void this.#send(), ms) as unknown as number;
  }

  async #send(): Promise<void> {
    if (this.#isSending) return this.#sendIn(REST_MS);
    this.#isSending = true;
    this.#host.kept("sending", null);
    const sent = this.#list;
    let problem: unknown = null;
    try {
      const body = JSON.stringify({ findings: sent });
      const headers = { "if-match": this.#stored.tag, "content-type": "application/json" };
      const answer = await send(this.#address, { method: "PUT", headers, body, keepalive: body.length < 60_000 });
      const stored = await readAnswer(answer);
      // The server has what was sent, and adds sides and times.
      this.#stored = { ...this.#stored, list: sent };
      this.#take(stored);
    } catch (error) {
      problem = error;
    }
    this.#isSending = false;
    await this.#afterwards(problem);
  }

  async #afterwards(problem: unknown): Promise<void> {
    if (problem === null) {
      if (this.isKept) return this.#host.kept("kept", null);
      return this.#sendIn(REST_MS);
    }
    const status = problem instanceof Problem ? problem.status : 0;
    if (status === 412) {
      // Another reader was faster: what is there now is joined with what is here, and sent.
      const read = await this.load().then(
        () => true,
        () => false,
      );
      return this.#sendIn(read ? 0 : AGAIN_MS);
    }
    const isRefused = status >= 400 && status < 500 && status !== 401 && status !== 409 && status !== 429;
    this.#host.kept(isRefused ? "refused" : "unsent", problem);
    if (!isRefused) this.#sendIn(AGAIN_MS);
  }

  /** Takes over what is stored now; what has been changed here since stays. */
  #take(stored: Stored): void {
    const { list, doubled } = merged(this.#stored.list, this.#list, stored.list);
    this.#stored = stored;
    this.#list = list;
    this.#host.shown(list);
    if (doubled > 0) this.#host.doubled(doubled);
  }
}

async function readAnswer(answer: Response): Promise<Stored> {
  const { findings } = (await answer.json()) as { readonly findings: readonly Finding[] };
  return { list: findings, tag: answer.headers.get("etag") ?? "" };
}
