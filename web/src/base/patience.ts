// Long work in short pieces, so that the page stays alive.

export const wait = (time_ms: number): Promise<void> => new Promise((resolve) => setTimeout(resolve, time_ms));

/** How long a piece of work may hold the page, in ms. */
const PIECE_MS = 6;

/** Lets the page do what waits, then goes on. A timer would wait four milliseconds at least. */
function breathe(): Promise<void> {
  return new Promise((resolve) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resolve();
    };
    port2.postMessage(null);
  });
}

/** Runs work to its end, a few milliseconds at a time; rejects with the signal's reason when it is aborted. */
export async function patiently<T>(work: Generator<void, T>, signal: AbortSignal): Promise<T> {
  for (;;) {
    const until = performance.now() + PIECE_MS;
    while (performance.now() < until) {
      const step = work.next();
      if (step.done) return step.value;
    }
    await breathe();
    signal.throwIfAborted();
  }
}
