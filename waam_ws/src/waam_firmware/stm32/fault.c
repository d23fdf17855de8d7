/* Faults of the processor (Cortex-M4 Devices Generic User Guide, 2.4 and 4.3): the outputs go off first, then the cause is
 * kept in memory that the startup does not clear. No floating point here: its registers may still be waiting for the stack. */
#include "fault.h"

#include "board.h"
#include "registers.h"
#include "waam_text.h"

#define MAGIC 0x57464C54u
#define NOT_KNOWN 0xFFFFFFFFu
#define GUARD_BYTES 2048u  /* more than the largest frame of a function (-Wframe-larger-than), so that none steps over it */
#define GUARD_BITS 11u
_Static_assert(1u << GUARD_BITS == GUARD_BYTES, "the region's size");

enum { RESET_CALL = 0, NMI = 2, HARD_FAULT = 3, MEMORY = 4, BUS = 5, USAGE = 6, PEND_SV = 14, IRQ_0 = 16 };
enum { FRAME_LR = 5, FRAME_PC = 6, FRAME_WORDS = 8 }; /* what the processor pushes */

typedef struct {
    uint32_t magic;
    uint32_t exception;         /* its number; 0: a call */
    uint32_t pc, lr;            /* of what was interrupted */
    uint32_t status, hard;      /* CFSR, HFSR */
    uint32_t address;           /* that could not be reached */
    uint32_t check;             /* of the words before */
} record_t;

extern const uint32_t _stack_guard[], _ram_start[], _stack_top[];
static record_t record __attribute__((section(".noinit")));
static uint32_t fault_stack[128] __attribute__((section(".noinit"), aligned(8), used));

static uint32_t check(void) { return waam_crc32((const char *)&record, offsetof(record_t, check)); }

static bool kept(void) { return record.magic == MAGIC && record.check == check(); }

static uint32_t fault_address(uint32_t status)
{
    return status & SCB_CFSR_MMARVALID ? SCB_MMFAR : status & SCB_CFSR_BFARVALID ? SCB_BFAR : NOT_KNOWN;
}

/* `frame`: where the stack pointer was. What could not be pushed cannot be read. */
static void keep(const uint32_t *frame, uint32_t link)
{
    uint32_t exception = exception_number(), status = SCB_CFSR;
    uint32_t at = (uint32_t)frame, room = (uint32_t)_stack_top - (uint32_t)_ram_start - FRAME_WORDS * 4;
    bool pushed = at - (uint32_t)_ram_start <= room && at % 4 == 0 && !(status & SCB_CFSR_STACKING);
    record = (record_t){.magic = MAGIC, .exception = exception, .status = status, .hard = SCB_HFSR,
                        .address = fault_address(status), .lr = NOT_KNOWN, .pc = NOT_KNOWN};
    if (exception == RESET_CALL) {
        record.pc = link;
    } else if (pushed) {
        record.pc = frame[FRAME_PC];
        record.lr = frame[FRAME_LR];
    }
    record.check = check();
}

/* The first fault is the cause; one in the handler does not hide it. */
__attribute__((used, noreturn)) static void fault_entry(const uint32_t *frame, uint32_t link)
{
    board_safe();
    if (!kept() || record.exception == PEND_SV)
        keep(frame, link);
    board_await_reset();
}

/* On a stack of its own: the usual one may be what is broken. */
__attribute__((naked)) void fault_handler(void)
{
    __asm__ volatile("cpsid i\n"
                     "mrs r0, msp\n"
                     "mov r1, lr\n"
                     "ldr r2, =fault_stack + 512\n"
                     "msr msp, r2\n"
                     "b fault_entry\n");
}

__attribute__((used)) static void main_loop_stands(const uint32_t *frame) { keep(frame, 0); }

/* Below all other interrupts, so what it has interrupted is the main loop. */
__attribute__((naked)) void PendSV_Handler(void)
{
    __asm__ volatile("mrs r0, msp\n"
                     "b main_loop_stands\n");
}

void fault_main_loop_stands(void) { SCB_ICSR = SCB_ICSR_PENDSVSET; }

void fault_main_loop_runs(void) { record.magic = 0; }

/* One region without any access below the stack; the rest of memory stays as it is. Costs nothing at run time. In handlers of
 * NMI and HardFault it is off, so that these can report. */
void fault_watch(void)
{
    MPU_RNR = 0;
    MPU_RBAR = (uint32_t)_stack_guard;
    MPU_RASR = MPU_RASR_XN | (GUARD_BITS - 1) << 1 | MPU_RASR_ENABLE;
    MPU_CTRL = MPU_CTRL_PRIVDEFENA | MPU_CTRL_ENABLE;
    SCB_SHPR3 |= 0xFFu << 16; /* PendSV: the lowest priority */
    SCB_SHCSR |= SCB_SHCSR_FAULTS;
    barrier();
}

static bool in_guard(uint32_t address) { return address - (uint32_t)_stack_guard < GUARD_BYTES; }

static const char *name(void)
{
    static const char *const core[] = {[RESET_CALL] = "the program ended itself", [NMI] = "the crystal stopped",
                                       [HARD_FAULT] = "hard fault", [MEMORY] = "memory protection", [BUS] = "bad address",
                                       [USAGE] = "illegal instruction", [PEND_SV] = "the main loop stood still"};
    uint32_t status = record.exception == PEND_SV ? 0 : record.status;
    if (status & SCB_CFSR_STACKING || in_guard(record.address))
        return "stack overflow";
    if (status & SCB_CFSR_UNDEFINSTR)
        return "undefined instruction";
    if (status & SCB_CFSR_BUS)
        return "bad address";
    if (record.exception == IRQ_0 + IRQ_PVD)
        return "the supply fell below 2.9 V";
    if (record.exception <= PEND_SV && core[record.exception])
        return core[record.exception];
    return "an interrupt that nobody serves";
}

static void hex(waam_text_t *text, const char *label, uint32_t value)
{
    waam_text_add(text, label);
    for (unsigned shift = 32; value != NOT_KNOWN && shift > 0; shift -= 4)
        waam_text_char(text, "0123456789abcdef"[value >> (shift - 4) & 0xFu]);
    if (value == NOT_KNOWN)
        waam_text_add(text, "unknown");
}

const char *fault_take(void)
{
    static waam_text_t text;
    waam_text_clear(&text);
    if (!kept())
        return NULL;
    waam_text_add(&text, name());
    hex(&text, ": pc ", record.pc);
    hex(&text, " lr ", record.lr);
    hex(&text, " cfsr ", record.status);
    hex(&text, " hfsr ", record.hard);
    hex(&text, " address ", record.address);
    waam_text_add(&text, " exception ");
    waam_text_uint(&text, record.exception);
    text.text[text.length] = '\0';
    record.magic = 0;
    return text.text;
}
