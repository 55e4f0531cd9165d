// The findings of a case on the server, joined with what other readers write.

import { signal } from "@preact/signals";

import { send } from "../base/api.ts";
import { number, t } from "../base/i18n.ts";
import { type Finding, areSame, merged } from "../model/findings.ts";
import { Sync } from "./sync.ts";

type List = readonly Finding[];

export class FindingsSync extends Sync<List> {
  /** That somebody else has changed the same findings: it stands until one of them is taken out. */
  readonly doubled = signal("");
  /** What a finding is known by on the page, if it is not its id: what is being written about goes on in its own. */
  readonly #keys = new Map<string, string>();

  constructor(path: string) {
    super(path, []);
  }

  protected override areSame(one: List, other: List): boolean {
    return areSame(one, other);
  }

  protected override joined(base: List, here: List, there: List): List {
    const { list, moved } = merged(base, here, there);
    for (const [id, own] of moved) {
      this.#keys.set(own, this.keyOf({ id }));
      this.#keys.set(id, own);
    }
    if (moved.length > 0) this.doubled.value = t("findings.doubled", { count: number(moved.length) });
    return list;
  }

  protected override bodyOf(findings: List): object {
    return { findings };
  }

  protected override valueOf(answer: unknown): List {
    return (answer as { readonly findings: List }).findings;
  }

  /** What a finding is known by on the page, also where it has got another id. */
  keyOf({ id }: Pick<Finding, "id">): string {
    return this.#keys.get(id) ?? id;
  }

  /** Reads what others have changed; what is changed here is joined with that when it is sent. */
  async look(): Promise<void> {
    if (this.isKept && this.isRead.peek()) await this.readAll();
  }

  /**
   * Sends what a file has in the place of the list as it is then, and takes what is made of both as the list. What others have added by then is in
   * it; what they add later refuses the file.
   */
  async take(body: (now: List) => string | Blob, type: string, made: (now: List, stored: List) => List): Promise<void> {
    await this.flush();
    await this.inTurn(async () => {
      const before = this.value.peek();
      const stored = await this.put(body(before), type);
      this.stored.value = stored;
      // What has been changed here meanwhile stays.
      this.change(merged(before, this.value.peek(), made(before, stored.value)).list);
    });
    await this.flush();
  }

  /** Adds the findings of another case, unconfirmed. */
  async takeOver(other: string): Promise<void> {
    await this.flush();
    const ask = async (): Promise<void> => {
      const headers = { "if-match": this.stored.peek().tag };
      this.adopt(await this.heard(await send(`${this.path}/from/${other}`, { method: "POST", headers })));
    };
    await this.inTurn(() => this.insist(ask));
  }
}
