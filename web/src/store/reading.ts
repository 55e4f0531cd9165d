// The reading of whoever looks at a case: the conclusion, kept on the server as it is typed, and its signature.

import { type ReadonlySignal, computed, signal } from "@preact/signals";

import { Problem, ask, send } from "../base/api.ts";
import { t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { type Finding, areSame } from "../model/findings.ts";
import {
  FIELDS,
  LONGEST_CONCLUSION,
  type ListedReading,
  type Reading as Kept,
  type Written,
} from "../model/readings.ts";
import { plainText } from "../model/text.ts";
import { announce } from "./announce.ts";
import { holder, isNamed, mayWrite } from "./holder.ts";
import { type Stored, Sync, resumed } from "./sync.ts";

interface Body extends Written {
  readonly findings: readonly Finding[];
}

/** What is signed: what was shown when the reader was asked, and who that was. */
export interface Seen extends Body {
  readonly reader: string | undefined;
}

/** What readers have written who had the page before, and what the server had of it, by key: they alone see it again. */
const UNSENT = new Map<string, { readonly value: Written; readonly stored: Stored<Written> }>();

export class Reading extends Sync<Written> {
  /** The findings of the case as they are shown. */
  #findings: ReadonlySignal<readonly Finding[]>;
  /** Who has read the case. */
  readonly all = signal<readonly ListedReading[]>([]);
  /** One's own, as the server has it; null: not known yet, or one has no name. */
  readonly mine = signal<Kept | null>(null);
  readonly isSigned = computed(() => this.mine.value?.state === "signed");
  /** Whether there is a reading to report: something is concluded. */
  readonly isBegun = computed(() => isConcluded(this.value.value));
  /** Whether something is written that the signed version has not. */
  readonly isAhead = computed(() => this.isSigned.value && !this.areSame(this.value.value, this.stored.value.value));
  /** Whether a signature or a correction is on its way. */
  readonly isBusy = signal(false);
  /** One's own last signed version. */
  readonly signed = computed(() => this.all.value.findLast((one) => one.is_mine && one.state === "signed"));

  private constructor(path: string, findings: ReadonlySignal<readonly Finding[]>) {
    super(path, { conclusion: "", template: {} });
    this.#findings = findings;
  }

  /** The reading of a case that is opened. */
  static of(id: string, findings: ReadonlySignal<readonly Finding[]>): Reading {
    const path = `v1/cases/${id}/readings/mine`;
    const reading = resumed(`${path} ${holder.peek()?.name}`, () => new Reading(path, findings));
    reading.#findings = findings;
    return reading;
  }

  protected override get key(): string {
    return `${this.path} ${this.mine.peek()?.reader}`;
  }

  protected override get isOpen(): boolean {
    return !this.isSigned.peek();
  }

  protected override get isSafe(): boolean {
    return super.isSafe && UNSENT.size === 0;
  }

  protected override areSame(one: Written, other: Written): boolean {
    return plain(one) === plain(other) && FIELDS.every((field) => one.template[field] === other.template[field]);
  }

  protected override joined(base: Written, here: Written, there: Written): Written {
    const [before, own, other] = [base, here, there].map(plain);
    const conclusion =
      own === before || own === other
        ? there.conclusion
        : other === before
          ? here.conclusion
          : [other, own].filter(Boolean).join("\n\n");
    const chosen = FIELDS.map((field) => {
      const { [field]: word } = here.template[field] === base.template[field] ? there.template : here.template;
      return [field, word] as const;
    });
    return { conclusion, template: Object.fromEntries(chosen.filter(([, word]) => word)) };
  }

  protected override bodyOf(written: Written): Body {
    const findings = isConcluded(written) ? this.#findings.peek() : [];
    return { conclusion: plain(written), template: written.template, findings };
  }

  protected override valueOf(answer: unknown): Written {
    const reading = answer as Kept;
    const before = this.mine.peek()?.reader;
    const [value, stored] = [this.value.peek(), this.stored.peek()];
    if (before && before !== reading.reader) {
      if (!this.areSame(value, stored.value)) UNSENT.set(this.key, { value, stored });
      this.value.value = stored.value;
    }
    this.mine.value = reading;
    const unsent = UNSENT.get(this.key);
    if (unsent) ({ value: this.value.value, stored: this.stored.value } = unsent);
    UNSENT.delete(this.key);
    return reading;
  }

  /** Reads who has read the case, and one's own reading, if one has a name. */
  protected override async readAll(): Promise<void> {
    const { readings } = await ask<{ readonly readings: readonly ListedReading[] }>(this.path.replace(/\/mine$/, ""));
    this.all.value = readings;
    if (isNamed.peek() && mayWrite.peek()) await super.readAll();
  }

  /** Shows a change of what is written, and keeps it. */
  write(change: Partial<Written>): void {
    this.change({ ...this.value.peek(), ...change });
  }

  /** What is shown now, to be signed. */
  get seen(): Seen {
    return { ...this.bodyOf(this.value.peek()), reader: this.mine.peek()?.reader };
  }

  /** Signs what was seen; whether it is signed now. */
  sign(seen: Seen): Promise<boolean> {
    return this.#act(async () => {
      await this.push(true);
      await this.inTurn(async () => {
        // What another window or another reader wrote was not read by whoever signs.
        const now = this.seen;
        if (now.reader !== seen.reader || !this.areSame(now, seen) || !areSame(now.findings, seen.findings))
          throw new Problem(412, "reading-changed", "");
        const headers = { "if-match": this.stored.peek().tag };
        this.adopt(await this.heard(await send(`${this.path}/signature`, { method: "POST", headers })));
      });
      announce(t("reading.done"));
    });
  }

  /**
   * Whose reading a report is of, once the server has it with the findings as they are shown; null: nothing is concluded, or what must be
   * signed is open. Without a conclusion in a correction, the signed version counts.
   */
  async reported(mustBeSigned = false): Promise<string | null> {
    // A file without a conclusion that could not be read would look as if there were none.
    if (isNamed.peek() && mayWrite.peek() && !this.isRead.peek()) await this.readAll();
    const mine = this.mine.peek();
    if (!mine) return null;
    const isBegun = this.isBegun.peek();
    const isSigned = this.isSigned.peek() || (mine.version > 1 && !isBegun);
    if (!isSigned && (mustBeSigned || !isBegun)) return null;
    if (this.isOpen) await this.push(true);
    return mine.reader;
  }

  /** Begins the next version of what is signed. */
  correct(): Promise<boolean> {
    return this.#act(() => this.push(true));
  }

  /** Does something, or says why it cannot be done. */
  async #act(work: () => Promise<void>): Promise<boolean> {
    this.isBusy.value = true;
    try {
      await work();
      return true;
    } catch (problem) {
      this.status.value = problemWords(problem);
      return false;
    } finally {
      this.isBusy.value = false;
      void this.load();
    }
  }
}

const plain = ({ conclusion }: Written): string => plainText(conclusion, LONGEST_CONCLUSION);
const isConcluded = ({ conclusion, template }: Written): boolean =>
  conclusion.trim() !== "" || Object.keys(template).length > 0;
