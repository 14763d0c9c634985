/*
 * Makes a head and writes it as an OBJ: at random, halfway to another one, its first direction changed. The file
 * begins with the coefficients, of which anyface_head_new() makes the same head again.
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
        status = anyface_head_mesh(run->head, 64, 1, NULL, &run->mesh, NULL, NULL, error);
    }
    return status;
}

static AnyfaceStatus save(Run *run, const char *path, AnyfaceError **error) {
    size_t vertices = anyface_mesh_vertex_count(run->mesh);
    size_t triangles = anyface_mesh_triangle_count(run->mesh);
    float coefficients[100], *places = malloc(vertices * 3 * sizeof *places);
    uint32_t *corners = malloc(triangles * 3 * sizeof *corners);
    AnyfaceStatus status = ANYFACE_STATUS_IO;
    if (places != NULL && corners != NULL) {
        status = anyface_mesh_copy_positions(run->mesh, places, vertices * 3, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_mesh_copy_triangles(run->mesh, corners, triangles * 3, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_head_copy_coefficients(run->head, coefficients, 100, error);
    }
    FILE *file = status == ANYFACE_STATUS_OK ? fopen(path, "w") : NULL;
    if (file != NULL) {
        for (size_t c = 0; c < 100; c++) {
            fprintf(file, c == 0 ? "# %.9g" : c == 99 ? " %.9g\n" : " %.9g", (double)coefficients[c]);
        }
        for (size_t v = 0; v < vertices; v++) {
            fprintf(file, "v %f %f %f\n", places[3 * v], places[3 * v + 1], places[3 * v + 2]);
        }
        for (size_t t = 0; t < triangles; t++) {
            fprintf(file, "f %u %u %u\n", corners[3 * t] + 1, corners[3 * t + 1] + 1, corners[3 * t + 2] + 1);
        }
        status = fclose(file) == 0 ? ANYFACE_STATUS_OK : ANYFACE_STATUS_IO;
        printf("%s: %zu vertices, %s changed\n", path, vertices, anyface_head_direction_name(run->head, 0));
    } else if (status == ANYFACE_STATUS_OK) {
        status = ANYFACE_STATUS_IO;
    }
    free(corners);
    free(places);
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
