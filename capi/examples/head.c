/*
 * Makes a head and writes it as an OBJ of quads: at random, halfway to another one, its first slider changed. The
 * file begins with its numbers, of which anyface_head_new() makes the same head again.
 *
 *     head SEED OUT.obj [OTHER_SEED] [VALUE]
 *     head 7 head.obj 12 1.5
 *
 * Build: cc -std=c11 head.c $(pkg-config --cflags --libs anyface) -o head
 */
#include <anyface.h>

#include <stdio.h>
#include <stdlib.h>

typedef struct {
    AnyfaceHead *first, *other, *mixed, *head;
    AnyfaceMesh *mesh;
} Run;

static void run_free(Run *run) {
    anyface_mesh_free(run->mesh);
    anyface_head_free(run->head);
    anyface_head_free(run->mixed);
    anyface_head_free(run->other);
    anyface_head_free(run->first);
}

static AnyfaceStatus make(Run *run, char **words, int count, AnyfaceError **error) {
    unsigned long long seed = strtoull(words[1], NULL, 10);
    unsigned long long other = count > 3 ? strtoull(words[3], NULL, 10) : seed;
    float value = count > 4 ? (float)atof(words[4]) : 0.0f;
    AnyfaceStatus status = anyface_head_new(NULL, NULL, 0, seed, &run->first, error);
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_new(NULL, NULL, 0, other, &run->other, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_new_mixed(run->first, run->other, 0.5f, &run->mixed, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_new_along(run->mixed, 0, value, &run->head, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_mesh(run->head, 0, 1, NULL, &run->mesh, NULL, NULL, error);
    }
    return status;
}

/* The last corner of a triangle comes twice. */
static void write_faces(FILE *file, AnyfaceHead *head, const uint32_t *faces, const uint32_t *kinds, size_t count) {
    for (size_t f = 0; f < count; f++) {
        const uint32_t *face = faces + 4 * f;
        if (f == 0 || kinds[f] != kinds[f - 1]) {
            fprintf(file, "usemtl %s\n", anyface_head_material_name(head, kinds[f]));
        }
        fprintf(file, "f %u %u %u", face[0] + 1, face[1] + 1, face[2] + 1);
        if (face[3] != face[2]) {
            fprintf(file, " %u", face[3] + 1);
        }
        fprintf(file, "\n");
    }
}

static AnyfaceStatus save(Run *run, const char *path, AnyfaceError **error) {
    size_t vertices = anyface_mesh_vertex_count(run->mesh), count = anyface_head_face_count(run->head);
    size_t size = anyface_head_coefficient_count(run->head);
    float *numbers = malloc(size * sizeof *numbers), *places = malloc(vertices * 3 * sizeof *places);
    uint32_t *faces = malloc(count * 4 * sizeof *faces), *kinds = malloc(count * sizeof *kinds);
    AnyfaceStatus status = ANYFACE_STATUS_IO;
    if (numbers != NULL && places != NULL && faces != NULL && kinds != NULL) {
        status = anyface_mesh_copy_positions(run->mesh, places, vertices * 3, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_copy_faces(run->head, faces, count * 4, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_copy_face_materials(run->head, kinds, count, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_copy_coefficients(run->head, numbers, size, error);
    }
    FILE *file = status == ANYFACE_STATUS_OK ? fopen(path, "w") : NULL;
    if (file != NULL) {
        fprintf(file, "#");
        for (size_t n = 0; n < size; n++) {
            fprintf(file, " %.9g", (double)numbers[n]);
        }
        fprintf(file, "\n");
        for (size_t v = 0; v < vertices; v++) {
            fprintf(file, "v %f %f %f\n", places[3 * v], places[3 * v + 1], places[3 * v + 2]);
        }
        write_faces(file, run->head, faces, kinds, count);
        status = fclose(file) == 0 ? ANYFACE_STATUS_OK : ANYFACE_STATUS_IO;
        printf("%s: %zu vertices, %s changed\n", path, vertices, anyface_head_direction_name(run->head, 0));
    } else if (status == ANYFACE_STATUS_OK) {
        status = ANYFACE_STATUS_IO;
    }
    free(kinds);
    free(faces);
    free(places);
    free(numbers);
    return status;
}

int main(int count, char **words) {
    if (count < 3) {
        fprintf(stderr, "usage: head SEED OUT.obj [OTHER_SEED] [VALUE]\n");
        return 2;
    }
    Run run = {0};
    AnyfaceError *error = NULL;
    AnyfaceStatus status = make(&run, words, count, &error);
    if (status == ANYFACE_STATUS_OK) {
        status = save(&run, words[2], &error);
    }
    if (status != ANYFACE_STATUS_OK) {
        fprintf(stderr, "head: %s\n", error != NULL ? anyface_error_message(error) : "the file cannot be written");
    }
    anyface_error_free(error);
    run_free(&run);
    return (int)status;
}
