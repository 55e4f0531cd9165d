// Requests to the server by way of the kernel of a notebook: its Python answers, wherever it and the server run.

import { type Carrier, carryBy } from "../base/api.ts";

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

/** The views that this notebook has shown. */
let views = 0;

/** Asks the Python behind a model about its case. What it does not answer, because the kernel has ended, is not answered. */
export class Kernel {
  /** The id of the case as this view alone has it in its requests: two views of one case may belong to two servers. */
  readonly own: string;
  readonly #id: string;
  readonly #model: Model;
  readonly #release: () => void;
  readonly #waiting = new Map<number, (answer: Answer, body: BlobPart | undefined) => void>();

  constructor(model: Model) {
    this.#model = model;
    this.#id = String(model.get("case_id"));
    this.own = `${this.#id}.${(views += 1)}`;
    model.on("msg:custom", this.#hear);
    this.#release = carryBy(`v1/cases/${this.own}`, (path, options) => this.#carry(path, options));
  }

  readonly #carry: Carrier = (path, { headers, signal }) =>
    new Promise((resolve, reject) => {
      signal?.throwIfAborted();
      // Other views of the same model hear the same answers.
      const ask = Math.random();
      const { accept = "*/*" } = Object.fromEntries(new Headers(headers));
      signal?.addEventListener("abort", () => {
        if (this.#waiting.delete(ask)) reject(signal.reason as Error);
      });
      this.#waiting.set(ask, ({ status, headers: its }, body) =>
        resolve(new Response(body ?? null, { status, headers: its })),
      );
      this.#model.send({ ask, path: path.replace(this.own, this.#id), accept });
    });

  readonly #hear = (content: Answer, buffers: readonly BlobPart[] = []): void => {
    const resolve = this.#waiting.get(content.answer);
    this.#waiting.delete(content.answer);
    resolve?.(content, buffers[0]);
  };

  dispose(): void {
    this.#release();
    this.#model.off("msg:custom", this.#hear);
  }
}
