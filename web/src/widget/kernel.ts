// Requests to the server by way of the kernel of a notebook: its Python answers, wherever it and the server run.

import type { Carrier } from "../base/api.ts";

/** What an anywidget gives to its front end: traits that Python has too, and messages. */
export interface Model {
  get(name: string): unknown;
  set(name: string, value: unknown): void;
  save_changes(): void;
  send(content: unknown): void;
  on(event: string, hear: (...of: never[]) => void): void;
  off(event: string, hear: (...of: never[]) => void): void;
}

interface Answer {
  /** The number of the question. */
  readonly answer: number;
  readonly status: number;
  readonly headers: Readonly<Record<string, string>>;
}

/** Asks the Python behind a model. What it does not answer, because the kernel has ended, is not answered. */
export class Kernel {
  readonly #model: Model;
  readonly #waiting = new Map<number, (answer: Answer, body: BlobPart | undefined) => void>();
  #isOver = false;

  constructor(model: Model) {
    this.#model = model;
    model.on("msg:custom", this.#hear);
  }

  readonly carry: Carrier = (path, { headers, signal }) =>
    new Promise((resolve, reject) => {
      signal?.throwIfAborted();
      // Other views of the same model hear the same answers.
      const ask = Math.random();
      const { accept = "*/*" } = Object.fromEntries(new Headers(headers));
      signal?.addEventListener("abort", () => {
        if (this.#waiting.delete(ask)) reject(signal.reason as Error);
        this.#rest();
      });
      this.#waiting.set(ask, ({ status, headers: its }, body) =>
        resolve(new Response(body ?? null, { status, headers: its })),
      );
      this.#model.send({ ask, path, accept });
    });

  readonly #hear = (content: Answer, buffers: readonly BlobPart[] = []): void => {
    const resolve = this.#waiting.get(content.answer);
    this.#waiting.delete(content.answer);
    resolve?.(content, buffers[0]);
    this.#rest();
  };

  /** Hears until all is answered that was asked: another view of the same case may have asked by way of this one. */
  dispose(): void {
    this.#isOver = true;
    this.#rest();
  }

  #rest(): void {
    if (this.#isOver && this.#waiting.size === 0) this.#model.off("msg:custom", this.#hear);
  }
}
