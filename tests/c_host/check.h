/* Assertions for the C test programs: they name the line and end the program with 1. */
#ifndef CHECK_H
#define CHECK_H

#include <anyface.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "%s:%d: not true: %s\n", __FILE__, __LINE__, #condition);              \
            exit(1);                                                                               \
        }                                                                                          \
    } while (0)

/* A call that must succeed; `error` is the variable that the call writes to. */
#define CHECK_OK(call)                                                                             \
    do {                                                                                           \
        if ((call) != ANYFACE_STATUS_OK) {                                                         \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, anyface_error_message(error));      \
            exit(1);                                                                               \
        }                                                                                          \
        CHECK(error == NULL);                                                                      \
    } while (0)

/* A call that must fail with this status and with a message that holds `part`. */
#define CHECK_FAILS(call, expected, part)                                                          \
    do {                                                                                           \
        AnyfaceStatus got = (call);                                                                \
        if (got != (expected) || error == NULL || anyface_error_status(error) != (expected) ||     \
            strstr(anyface_error_message(error), (part)) == NULL) {                                \
            fprintf(stderr, "%s:%d: expected %s with \"%s\", got %s: %s\n", __FILE__, __LINE__,    \
                    anyface_status_name(expected), (part), anyface_status_name(got),               \
                    anyface_error_message(error));                                                 \
            exit(1);                                                                               \
        }                                                                                          \
        anyface_error_free(error);                                                                 \
        error = NULL;                                                                              \
    } while (0)

#endif
