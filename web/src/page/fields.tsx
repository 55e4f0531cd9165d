// The parts that panels are made of.

import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef, useState } from "preact/hooks";

import type { Icon as IconName } from "../base/dom.ts";
import { type Key, number, t } from "../base/i18n.ts";
import { excessOf, plainText } from "../model/text.ts";
import { mayWrite } from "../store/holder.ts";
import { type Task, preferences, unfold } from "../store/preferences.ts";
import type { Store } from "../store/store.ts";

/** As wide as the style sheet has menus, with its rim. */
const MENU_PIXELS = 296;

export interface OfStore {
  readonly store: Store;
}

/** What else can be said of an element. */
interface Attributes {
  readonly id?: string;
  readonly class?: string;
  readonly title?: string;
  readonly hidden?: boolean;
  readonly disabled?: boolean;
  readonly [name: `data-${string}` | `aria-${string}`]: string | boolean | undefined;
}
interface ButtonAttributes extends Attributes {
  readonly value?: string;
  readonly dir?: "auto";
  readonly tabIndex?: number;
  onClick?(): void;
}
interface TypedAttributes extends Attributes {
  readonly maxLength?: number;
  readonly dir?: "auto";
  readonly autocomplete?: "off";
  readonly placeholder?: string;
  readonly inputMode?: "decimal";
  readonly step?: string;
}
interface FileAttributes extends Attributes {
  readonly accept?: string;
  readonly multiple?: boolean;
  readonly webkitdirectory?: boolean;
}
interface Children {
  readonly children?: ComponentChildren;
}

export const Icon = ({ name }: { readonly name: IconName }) => (
  <svg class="icon" aria-hidden="true" focusable="false">
    <use href={`#icon-${name}`} />
  </svg>
);

/** A button with an icon alone; its label is read out, and shown when the pointer rests on it. */
export const IconButton = ({
  icon,
  label,
  ...rest
}: { readonly icon: IconName; readonly label: string } & ButtonAttributes) => (
  <button type="button" class="icon-button" aria-label={label} title={label} {...rest}>
    <Icon name={icon} />
  </button>
);

export const Button = (attributes: ButtonAttributes & Children) => <button type="button" {...attributes} />;

/** An element that is made elsewhere, among components; `alt` are the words of a picture. */
export function Placed({ node, alt = "" }: { readonly node: HTMLElement; readonly alt?: string }) {
  const place = useRef<HTMLSpanElement>(null);
  useLayoutEffect(() => {
    if (node instanceof HTMLImageElement) node.alt = alt;
    place.current?.replaceChildren(node);
  }, [node, alt]);
  return <span class="mounted" ref={place} />;
}

/** A part of the panel, under its title; whether it is unfolded is remembered. */
export const Section = ({
  title,
  name = "",
  onOpen,
  children,
  ...rest
}: {
  readonly title: Key;
  readonly name?: string;
  /** The tab that shows it. */
  readonly "data-task": Task;
  onOpen?(): void;
} & Children &
  Attributes) => (
  <details
    class={`group ${name}`.trimEnd()}
    open={preferences.value.unfolded.includes(title)}
    onToggle={({ currentTarget: { open } }) => {
      unfold(title, open);
      if (open) onOpen?.();
    }}
    {...rest}
  >
    <summary>{t(title)}</summary>
    <div class="group-body">{children}</div>
  </details>
);

/** Words of little weight; nothing where there are none. */
export const Quiet = ({ children, ...rest }: Attributes & Children) =>
  children === "" ? null : (
    <p class="quiet" {...rest}>
      {children}
    </p>
  );

/** Where something is reported, also to those who do not see it. */
export const Status = ({ words, ...rest }: { readonly words: string } & Attributes) => (
  <p class="quiet" role="status" hidden={words === ""} {...rest}>
    {words}
  </p>
);

export const Line = ({
  label,
  isTall = false,
  children,
  ...rest
}: { readonly label: string; readonly isTall?: boolean } & Children & Attributes) => (
  <div class={isTall ? "line tall" : "line"} {...rest}>
    <span class="line-label" aria-hidden="true">
      {label}
    </span>
    {children}
  </div>
);

export const Bar = ({
  label,
  share,
  words,
  ...rest
}: { readonly label: string; readonly share: number; readonly words: string } & Attributes) => (
  <Line label={label} {...rest}>
    <meter value={share} aria-label={`${label}: ${words}`} />
    <span class="value quiet" aria-hidden="true">
      {words}
    </span>
  </Line>
);

/** A button with a box of controls, which lies over the page until a hand is elsewhere. */
export function Menu({
  name,
  button,
  children,
  ...rest
}: { readonly name: string; readonly button: ComponentChildren } & Children & Attributes) {
  const id = `menu-${name}`;
  const opener = useRef<HTMLButtonElement>(null);
  // It stands below its button, or above it where that is low.
  const place = (box: HTMLElement): void => {
    const { left, top, bottom } = opener.current?.getBoundingClientRect() ?? new DOMRect();
    const isLow = top > innerHeight / 2;
    const rest = document.documentElement.clientWidth - MENU_PIXELS;
    box.style.left = `${Math.max(0, Math.min(left, rest))}px`;
    box.style.top = isLow ? "auto" : `${bottom + 2}px`;
    box.style.bottom = isLow ? `${innerHeight - top + 2}px` : "auto";
    box.style.maxHeight = `${(isLow ? top : innerHeight - bottom) - 8}px`;
  };
  return (
    <>
      <button type="button" popovertarget={id} ref={opener} {...rest}>
        {button}
      </button>
      <div id={id} class="menu" popover="auto" onBeforeToggle={({ currentTarget }) => place(currentTarget)}>
        {children}
      </div>
    </>
  );
}

export const Row = ({ children }: Children) => <div class="row">{children}</div>;

/** Controls that change what is stored: disabled for whoever may only look. */
export const Writing = ({ children }: Children) => (
  <fieldset class="writing" disabled={!mayWrite.value}>
    {children}
  </fieldset>
);

export const Ticked = ({
  words,
  checked,
  onTick,
  ...rest
}: { readonly words: string; readonly checked: boolean; onTick(isTicked: boolean): void } & Attributes) => (
  <label class="inline">
    <input
      type="checkbox"
      checked={checked}
      onChange={({ currentTarget }) => onTick(currentTarget.checked)}
      {...rest}
    />
    {words}
  </label>
);

interface Choosing<Value> extends Attributes {
  readonly label: string;
  readonly values: readonly Value[];
  readonly value: Value;
  words(value: Value): string;
  onChoose(value: Value): void;
}

export const Choice = <Value extends string | number>({
  label,
  values,
  value,
  words,
  onChoose,
  ...rest
}: Choosing<Value>) => (
  <select
    aria-label={label}
    value={value}
    onChange={({ currentTarget }) => onChoose(values[currentTarget.selectedIndex] as Value)}
    {...rest}
  >
    {values.map((one) => (
      <option key={one} value={one}>
        {words(one)}
      </option>
    ))}
  </select>
);

export const LabelledChoice = <Value extends string | number>({
  isInline = false,
  ...choosing
}: Choosing<Value> & { readonly isInline?: boolean }) => (
  <label class={isInline ? "inline" : undefined}>
    {choosing.label}
    <Choice {...choosing} />
  </label>
);

/** A labelled line with a choice, and what else it has. */
export const ChoiceLine = <Value extends string | number>({
  isTall = false,
  children,
  ...choosing
}: Choosing<Value> & { readonly isTall?: boolean } & Children) => (
  <Line label={choosing.label} isTall={isTall}>
    <Choice {...choosing} />
    {children}
  </Line>
);

export const Buttons = <Value extends string>({
  label,
  values,
  value,
  words,
  onChoose,
  name = "",
  about = () => ({}),
}: {
  readonly label: string;
  readonly values: readonly Value[];
  /** The one that is chosen, if any. */
  readonly value: Value | null;
  words(value: Value): string;
  onChoose(value: Value): void;
  readonly name?: string;
  about?(value: Value): ButtonAttributes;
}) => (
  <div class={`buttons ${name}`.trimEnd()} role="group" aria-label={label}>
    {values.map((one) => (
      <button
        key={one}
        type="button"
        value={one}
        aria-pressed={one === value ? "true" : "false"}
        onClick={() => onChoose(one)}
        {...about(one)}
      >
        {words(one)}
      </button>
    ))}
  </div>
);

/** A slider with its label and, beside it, what its place means. */
export const Slider = ({
  id,
  label,
  range: [min = 0, max = 1, step = 1],
  value,
  words,
  onSlide,
}: {
  readonly id: string;
  readonly label: string;
  /** The least, the greatest, a step. */
  readonly range: readonly number[];
  readonly value: number;
  readonly words: string;
  onSlide(value: number): void;
}) => (
  <Line label={label}>
    <input
      type="range"
      id={id}
      aria-label={label}
      aria-valuetext={words}
      min={min}
      max={max}
      step={step}
      value={value}
      onInput={({ currentTarget }) => onSlide(currentTarget.valueAsNumber)}
    />
    <span class="value quiet" aria-hidden="true">
      {words}
    </span>
  </Line>
);

type Keyed = KeyboardEvent & { readonly currentTarget: HTMLInputElement };

/** An input that keeps what is typed until it is left, and shows `value` again then; `same` says whether it shows that already. */
export const Typed = ({
  type = "text",
  value,
  same = (typed) => typed === value,
  onType,
  onLeave,
  ...rest
}: {
  readonly value: string;
  same?(typed: string): boolean;
  onType?(typed: string): void;
  /** The field is left with this in it; what it returns, if anything, takes its place. */
  onLeave?(typed: string): string | void;
} & TypedAttributes & {
    readonly type?: "text" | "number";
    onKeyDown?(event: Keyed): void;
    onBlur?(event: { readonly currentTarget: HTMLInputElement }): void;
  }) => {
  const field = useRef<HTMLInputElement>(null);
  const isTyping = useRef(false);
  useLayoutEffect(() => {
    const input = field.current;
    if (input && !isTyping.current && !same(input.value)) input.value = value;
  });
  return (
    <input
      type={type as "text"}
      ref={field}
      onInput={({ currentTarget }) => {
        isTyping.current = !onType;
        onType?.(currentTarget.value);
      }}
      onChange={({ currentTarget }) => {
        isTyping.current = false;
        const left = onLeave?.(currentTarget.value);
        currentTarget.value = typeof left === "string" ? left : value;
      }}
      {...rest}
    />
  );
};

/** A text of several lines. What is too long stays as it is typed, to be shortened by hand. */
export function Written({
  value,
  most,
  excessWords,
  onType,
  onLeave = () => {},
  ...rest
}: {
  readonly value: string;
  /** The most characters of it. */
  readonly most: number;
  excessWords(values: { readonly most: string; readonly excess: string }): string;
  onType(typed: string): void;
  onLeave?(): void;
} & TypedAttributes & { readonly rows?: number }) {
  const field = useRef<HTMLTextAreaElement>(null);
  const [excess, setExcess] = useState(0);
  const plain = (typed: string): string => plainText(typed, most);
  useLayoutEffect(() => {
    const area = field.current;
    // What is being typed says the same, but for a space at its end.
    if (!area || plain(area.value) === value) return;
    area.value = value;
    setExcess(0);
  }, [value]);
  return (
    <>
      <textarea
        ref={field}
        dir="auto"
        onInput={({ currentTarget }) => {
          setExcess(excessOf(currentTarget.value, most));
          onType(plain(currentTarget.value));
        }}
        onChange={({ currentTarget }) => {
          if (excess === 0) currentTarget.value = plain(currentTarget.value);
          onLeave();
        }}
        {...rest}
      />
      <Status class="doubtful" words={excess > 0 ? excessWords({ most: number(most), excess: number(excess) }) : ""} />
    </>
  );
}

/** What is clicked in the place of a file input, below its label, and above what is to be known of it; a file may be chosen again. */
export const FileInput = ({
  words,
  label = <span class="visually-hidden">{words}</span>,
  hint,
  onFiles,
  ...rest
}: {
  readonly words: string;
  readonly label?: ComponentChildren;
  readonly hint?: string;
  onFiles(files: readonly File[]): void;
} & FileAttributes) => (
  <label class="file">
    {label}
    <input
      type="file"
      onChange={({ currentTarget }) => {
        onFiles([...(currentTarget.files ?? [])]);
        currentTarget.value = "";
      }}
      {...rest}
    />
    <span class="file-button" aria-hidden="true">
      {words}
    </span>
    {hint && <span class="quiet">{hint}</span>}
  </label>
);

export const Search = ({
  label,
  onSearch,
  ...rest
}: { readonly label: string; onSearch(typed: string): void } & Attributes) => (
  <input
    type="search"
    maxLength={100}
    placeholder={label}
    aria-label={label}
    onInput={({ currentTarget }) => onSearch(currentTarget.value.trim())}
    // In a dialog it would press a button.
    onKeyDown={(event) => event.key === "Enter" && event.preventDefault()}
    {...rest}
  />
);

export const Remark = ({
  name = "",
  role = "status",
  hidden = false,
  dismiss,
  children,
}: {
  readonly name?: string;
  readonly role?: "status" | "note";
  readonly hidden?: boolean;
  dismiss(): void;
} & Children) => (
  <div class={`notice-line remark ${name}`.trimEnd()} role={role} hidden={hidden}>
    {children}
    <IconButton icon="close" label={t("notice.dismiss")} onClick={dismiss} />
  </div>
);
