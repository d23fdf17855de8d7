/* What went wrong, kept over the reset that follows, and the guard below the stack. */
#ifndef WAAM_STM32_FAULT_H
#define WAAM_STM32_FAULT_H

/* Every exception without a handler of its own, and whoever cannot go on: outputs off, the cause kept, then the watchdog. */
void fault_handler(void);
/* Faults get handlers of their own, and memory protection makes a stack that overflows one of them. */
void fault_watch(void);
/* From the fast tick: the main loop stands still. Keeps where, if it can be interrupted there. */
void fault_main_loop_stands(void);
/* It goes on after all. */
void fault_main_loop_runs(void);
/* In words, what was kept before this start; NULL: nothing. Once only. */
const char *fault_take(void);

#endif
