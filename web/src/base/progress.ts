// How far a case is, told by the server instead of asked for. HTTP/1.1 allows six connections to a host, so all tabs of
// a browser share one stream: the tab that holds a lock reads it, and passes on what it hears.

import type { Case } from "../model/case.ts";
import { send } from "./api.ts";
import { wait } from "./patience.ts";

/** What the lock and the channel are called. */
const NAME = "isocortex-progress";
/** How long to wait before a stream that broke is asked for again, in ms. */
const AGAIN_MS = 2000;

/** The cases in a stream of server-sent events; other events, and comments, are passed over. */
export async function* casesOf(body: ReadableStream<Uint8Array>): AsyncGenerator<Case> {
  const reader = body.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const events = (text + value).split("\n\n");
    text = events.pop() ?? "";
    for (const event of events) {
      const field = (name: string): string =>
        event
          .split("\n")
          .filter((line) => line.startsWith(`${name}:`))
          .map((line) => line.slice(name.length + 1).trim())
          .join("\n");
      if (field("event") === "case") yield JSON.parse(field("data")) as Case;
    }
  }
}

export class Progress {
  /** Whether one of the tabs follows a case: browsers have locks only where the page came safely. */
  readonly isShared = "locks" in navigator;
  readonly #hear: (one: Case) => void;
  readonly #channel = new BroadcastChannel(NAME);
  readonly #gone = new AbortController();
  #wanted: string | null = null;
  #wake: () => void = () => {};

  /** `hear` gets a case whenever it has changed, whichever tab follows it. */
  constructor(hear: (one: Case) => void) {
    this.#hear = hear;
    this.#channel.onmessage = ({ data }: MessageEvent<Case>) => hear(data);
    const { signal } = this.#gone;
    if (this.isShared) navigator.locks.request(NAME, { signal }, () => this.#lead()).catch(() => {});
  }

  /** The case to follow, if this is the tab that does; null: none. */
  follow(id: string | null): void {
    this.#wanted = id;
    this.#wake();
  }

  dispose(): void {
    this.#gone.abort();
    this.#channel.close();
    this.#wake();
  }

  /** Follows one case after the other, as long as the page is there. */
  async #lead(): Promise<void> {
    const { signal } = this.#gone;
    while (!signal.aborted) {
      const id = this.#wanted;
      if (id === null) {
        await new Promise<void>((resolve) => (this.#wake = resolve));
        continue;
      }
      await this.#read(id, signal);
      // Until another case is named; one that is still wanted is asked for again.
      if (this.#wanted === id && !signal.aborted) await wait(AGAIN_MS);
    }
  }

  async #read(id: string, signal: AbortSignal): Promise<void> {
    try {
      const { body } = await send(`v1/cases/${id}/events`, { signal, cache: "no-store" });
      if (!body) return;
      for await (const one of casesOf(body)) {
        this.#channel.postMessage(one);
        this.#hear(one);
      }
    } catch {
      // The list is asked for in any case, and says what is wrong.
    }
  }
}
