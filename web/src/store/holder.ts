// Who looks at the page, and what they may do.

import { computed, signal } from "@preact/signals";

import type { Holder } from "../base/api.ts";

/** Null: not known yet, or nobody in particular. */
export const holder = signal<Holder | null>(null);

/** Whether what is stored may be changed; the server decides. */
export const mayWrite = computed(() => holder.value?.scopes.includes("write") ?? true);

/** Whether it is one person, who can answer for a reading: everybody on this machine, and whoever has the token without a name, is nobody. */
export const isNamed = computed(() => !["anybody", "token", undefined].includes(holder.value?.name));
