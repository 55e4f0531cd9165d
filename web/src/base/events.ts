// Server-sent events out of a stream of text (fetch can send a token with the request, EventSource cannot).

export interface ServerEvent {
  readonly event: string;
  readonly data: string;
}

/** Takes the text as it comes, in pieces of any length, and gives the events that are complete. */
export class EventReader {
  #rest = "";

  read(text: string): ServerEvent[] {
    // A carriage return at the end may be the first half of a line's end.
    const whole = (this.#rest + text).replace(/\r\n/g, "\n");
    const blocks = whole.split("\n\n");
    this.#rest = blocks.pop() ?? "";
    return blocks.map(parse).filter((event) => event !== null);
  }
}

function parse(block: string): ServerEvent | null {
  const lines = block.split("\n");
  const values = (field: string): string[] =>
    lines.filter((line) => line.startsWith(`${field}:`)).map((line) => line.slice(field.length + 1).replace(/^ /, ""));
  const data = values("data");
  return data.length > 0 ? { event: values("event").at(-1) ?? "message", data: data.join("\n") } : null;
}
