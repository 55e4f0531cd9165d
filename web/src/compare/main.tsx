// The page that shows two cases side by side, linked in angle, depth, window and point.

import { type Signal, effect, signal } from "@preact/signals";
import { render } from "preact";

import { allCases, ask, handOver, takeHanded } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { number, t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { problemWords } from "../base/problem-words.ts";
import type { Case } from "../model/case.ts";
import { linked } from "../model/linked.ts";
import { type Affine, inverted, subtract, transform } from "../model/space.ts";
import { begin } from "../page/begin.ts";
import { LabelledChoice, Placed, Quiet, Ticked } from "../page/fields.tsx";
import { angleOf } from "../model/nudge.ts";
import { Side } from "./side.ts";

/** The cases are asked for again after so long. */
const LIST_MS = 8000;
/** How long both rest before the address follows them. */
const REST_MS = 600;

interface Registration {
  /** From the patient space of the second case to that of the first. */
  readonly case_from_other: Affine;
  readonly verdict: "registered" | "rough";
}

/** How far a transform moves the middle of a head, and turns it, in words. */
function motionWords(affine: Affine, middle: readonly [number, number, number]): string {
  const shift = Math.hypot(...subtract(transform(affine, middle), middle));
  return t("compare.registered", { shift: number(shift, 1), angle: number(angleOf(affine), 1) });
}

class Comparing {
  readonly cases: Signal<readonly Case[]>;
  readonly left = new Side("left", (side) => this.#changed(side));
  readonly right = new Side("right", (side) => this.#changed(side));
  /** How the heads lie to each other, or why that is not known. */
  readonly verdict = signal({ words: "", isRough: false });
  readonly isLinked = signal(true);
  readonly #registration = signal<Registration | null>(null);
  #timer = 0;
  #trouble = "";
  #opened = Promise.resolve();

  constructor(cases: readonly Case[]) {
    this.cases = signal(cases);
    effect(() => {
      const isLinked = this.isLinked.value && this.#registration.value !== null;
      document.body.dataset.linked = String(isLinked);
      if (isLinked) this.#changed(this.left);
    });
  }

  /** Keeps the list of cases fresh as long as the page is looked at. */
  async followCases(): Promise<void> {
    for (;;) {
      await wait(LIST_MS);
      if (!document.hidden) this.cases.value = await allCases().catch(() => this.cases.peek());
    }
  }

  async start(asked: string): Promise<void> {
    const [left = "", right = ""] = asked.split("/");
    if (left) void this.#open(this.left, left);
    if (right) void this.#open(this.right, right);
    await this.#opened;
    await this.#register();
  }

  async choose(side: Side, id: string): Promise<void> {
    // What was found of the other pair says nothing of this one.
    this.#unlink("");
    await this.#open(side, id);
    await this.#register();
  }

  /** Opens one frame after the other: each takes the token once. What is being opened on that side is given up. */
  #open(side: Side, address: string): Promise<void> {
    side.close();
    if (address) side.expect();
    this.#trouble = "";
    const open = async (): Promise<void> => {
      handOver();
      try {
        await side.open(address);
      } catch (problem) {
        this.#trouble = problemWords(problem);
      }
      takeHanded();
    };
    return (this.#opened = this.#opened.then(open));
  }

  /** Asks how the heads lie to each other, and links them. */
  async #register(): Promise<void> {
    const [left, right] = [this.left.now, this.right.now];
    // A warning in one frame must not shift its picture against the other.
    const isWarned = this.left.isWarned || this.right.isWarned;
    for (const side of [this.left, this.right]) side.makeRoom(isWarned);
    this.#addressLater();
    if (!left || !right) return this.#unlink(this.#trouble || t("compare.choose-both"));
    this.#unlink(t("compare.registering"));
    // Others may be chosen in the meantime.
    const isStillShown = (): boolean => left.shown === this.left.now?.shown && right.shown === this.right.now?.shown;
    const path = `v1/cases/${left.shown.id}/registration?with=${right.shown.id}`;
    try {
      const found = await ask<Registration>(path, {});
      if (!isStillShown()) return;
      const { case_from_other, verdict } = found;
      const isRough = verdict !== "registered";
      const { center_in_patient } = right.shown.envelope_sphere;
      const words = isRough ? t("compare.rough") : motionWords(case_from_other, center_in_patient);
      this.verdict.value = { words, isRough };
      this.#registration.value = found;
    } catch (problem) {
      if (isStillShown()) this.#unlink(problemWords(problem));
    }
  }

  /** Both go their own ways, for a reason. */
  #unlink(words: string): void {
    this.#registration.value = null;
    this.verdict.value = { words, isRough: false };
  }

  /** One side was changed: the other one follows. */
  #changed(side: Side): void {
    this.#addressLater();
    const other = side === this.left ? this.right : this.left;
    const [one, its, found] = [side.now, other.now, this.#registration.peek()];
    if (!one || !its || !found || !this.isLinked.peek()) return;
    const left_from_right = found.case_from_other;
    const one_from_other = side === this.left ? left_from_right : inverted(left_from_right);
    if (one_from_other) other.follow(linked(one, its, one_from_other));
  }

  /** Both states in the address, so that it can be opened again. */
  #addressLater(): void {
    clearTimeout(this.#timer);
    this.#timer = window.setTimeout(() => {
      history.replaceState(null, "", `#${this.left.address}/${this.right.address}`);
    }, REST_MS);
  }
}

function Bar({ comparing }: { readonly comparing: Comparing }) {
  const { words, isRough } = comparing.verdict.value;
  return (
    <header class="bar">
      <a href="./" class="home">
        Isocortex
      </a>
      <h1>{t("compare.title")}</h1>
      <SideChoice comparing={comparing} side={comparing.left} />
      <SideChoice comparing={comparing} side={comparing.right} />
      <Ticked
        id="linked"
        words={t("compare.linked")}
        checked={comparing.isLinked.value}
        onTick={(isTicked) => (comparing.isLinked.value = isTicked)}
      />
      <p class={isRough ? "verdict warn" : "verdict"} role="status">
        {words}
      </p>
      <p class="research" role="note">
        {t("notice.long")}
      </p>
    </header>
  );
}

function SideChoice({ comparing, side }: { readonly comparing: Comparing; readonly side: Side }) {
  const chosen = side.chosen.value;
  const offered = comparing.cases.value.filter(({ id, state }) => state === "ready" || id === chosen);
  const names = new Map([["", t("compare.choose")], ...offered.map((one) => [one.id, caseIdentity(one)] as const)]);
  return (
    <LabelledChoice
      id={`compare-${side.name}`}
      isInline
      label={side.title}
      values={[...names.keys()]}
      value={chosen}
      words={(id) => names.get(id) ?? ""}
      onChoose={(id) => void comparing.choose(side, id)}
    />
  );
}

/** Runs the document. */
export async function comparing(): Promise<void> {
  // The page leaves what it shows beside the token, which is taken by whoever asks for it.
  const asked = (location.hash || String(sessionStorage.left ?? "")).replace(/^#/, "");
  // Whoever must sign in comes back to this address.
  if (asked) history.replaceState(null, "", `#${asked}`);
  const place = await begin("app");
  document.title = `${t("compare.title")} · Isocortex`;
  try {
    const both = new Comparing(await allCases());
    render(
      <>
        <Bar comparing={both} />
        <main class="frames">
          <Placed node={both.left.element} />
          <Placed node={both.right.element} />
        </main>
      </>,
      place,
    );
    void both.followCases();
    await both.start(asked);
  } catch (problem) {
    render(<Quiet>{problemWords(problem)}</Quiet>, place);
  }
}
