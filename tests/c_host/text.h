/* A whole file as text; the next call overwrites it. */
#ifndef TEXT_H
#define TEXT_H

#include "check.h"

static char *read_text(const char *path) {
    static char text[1 << 20];
    FILE *file = fopen(path, "rb");
    CHECK(file != NULL);
    size_t length = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    CHECK(length > 0 && length < sizeof text - 1);
    text[length] = '\0';
    return text;
}

#endif
