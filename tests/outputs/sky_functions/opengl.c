// Runs the compute shader `shader.glsl` of the current folder by OpenGL, without a window: argument 1 says how often,
// argument 2 how many numbers it answers. `given` and `values` are its buffers 0 and 2; the answers, buffer 1, go to the
// standard output. Exit code 77: this machine has no OpenGL that computes.
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void none(const char *what) {
    fprintf(stderr, "no OpenGL: %s\n", what);
    exit(77);
}

// The address of a function is copied, because C has no cast between the two kinds of pointers.
static void (*(*address)(const char *))(void);

static void gl(void *place, const char *name) {
    void (*const found)(void) = address(name);
    if (!found) none(name);
    memcpy(place, &found, sizeof found);
}

static void egl(void *library, void *place, const char *name) {
    void *const found = dlsym(library, name);
    if (!found) none(name);
    memcpy(place, &found, sizeof found);
}

static char *whole(const char *name, long *size) {
    FILE *file = fopen(name, "rb");
    if (!file || fseek(file, 0, SEEK_END)) exit(1);
    *size = ftell(file);
    rewind(file);
    char *held = calloc((size_t)*size + 1, 1);
    if (!held || fread(held, 1, (size_t)*size, file) != (size_t)*size) exit(1);
    fclose(file);
    return held;
}

int main(int count, char **arguments) {
    if (count != 3) return 1;
    const int skies = atoi(arguments[1]);
    const long answers = atol(arguments[2]);
    void *library = dlopen("libEGL.so.1", RTLD_NOW);
    if (!library) none("libEGL.so.1");
    egl(library, &address, "eglGetProcAddress");
    void *(*get_display)(void *), *(*create_context)(void *, void *, void *, const int *);
    unsigned (*initialize)(void *, int *, int *), (*bind_api)(unsigned), (*make_current)(void *, void *, void *, void *);
    egl(library, &get_display, "eglGetDisplay");
    egl(library, &initialize, "eglInitialize");
    egl(library, &bind_api, "eglBindAPI");
    egl(library, &create_context, "eglCreateContext");
    egl(library, &make_current, "eglMakeCurrent");
    void *const display = get_display(NULL);
    if (!initialize(display, NULL, NULL)) none("a display without a window");
    if (!bind_api(0x30A2)) none("OpenGL");
    const int version[] = {0x3098, 4, 0x30FB, 3, 0x3038};
    void *const context = create_context(display, NULL, NULL, version);
    if (!context || !make_current(display, NULL, NULL, context)) none("a context of OpenGL 4.3");

    unsigned (*create_shader)(unsigned), (*create_program)(void), (*get_error)(void);
    void (*shader_source)(unsigned, int, const char **, const int *), (*compile_shader)(unsigned);
    void (*attach_shader)(unsigned, unsigned), (*link_program)(unsigned), (*use_program)(unsigned);
    void (*get_program)(unsigned, unsigned, int *), (*get_log)(unsigned, int, int *, char *);
    void (*gen_buffers)(int, unsigned *), (*bind_buffer)(unsigned, unsigned);
    void (*buffer_data)(unsigned, intptr_t, const void *, unsigned), (*bind_base)(unsigned, unsigned, unsigned);
    void (*dispatch)(unsigned, unsigned, unsigned), (*barrier)(unsigned);
    void (*get_data)(unsigned, intptr_t, intptr_t, void *);
    gl(&create_shader, "glCreateShader");
    gl(&create_program, "glCreateProgram");
    gl(&get_error, "glGetError");
    gl(&shader_source, "glShaderSource");
    gl(&compile_shader, "glCompileShader");
    gl(&attach_shader, "glAttachShader");
    gl(&link_program, "glLinkProgram");
    gl(&use_program, "glUseProgram");
    gl(&get_program, "glGetProgramiv");
    gl(&get_log, "glGetShaderInfoLog");
    gl(&gen_buffers, "glGenBuffers");
    gl(&bind_buffer, "glBindBuffer");
    gl(&buffer_data, "glBufferData");
    gl(&bind_base, "glBindBufferBase");
    gl(&dispatch, "glDispatchCompute");
    gl(&barrier, "glMemoryBarrier");
    gl(&get_data, "glGetBufferSubData");

    long size;
    const char *source = whole("shader.glsl", &size);
    const unsigned shader = create_shader(0x91B9);
    shader_source(shader, 1, &source, NULL);
    compile_shader(shader);
    const unsigned program = create_program();
    attach_shader(program, shader);
    link_program(program);
    int good = 0;
    char said[4096] = "";
    get_program(program, 0x8B82, &good);
    if (!good) {
        get_log(shader, sizeof said, NULL, said);
        fprintf(stderr, "%s\n", said);
        return 1;
    }
    unsigned buffers[3];
    gen_buffers(3, buffers);
    for (unsigned k = 0; k < 3; k++) {
        long bytes = answers * 4;
        char *held = k == 1 ? calloc((size_t)answers, 4) : whole(k ? "values" : "given", &bytes);
        bind_buffer(0x90D2, buffers[k]);
        buffer_data(0x90D2, bytes, held, 0x88E9);
        bind_base(0x90D2, k, buffers[k]);
        free(held);
    }
    use_program(program);
    dispatch((unsigned)skies, 1, 1);
    barrier(0xFFFFFFFF);
    float *found = calloc((size_t)answers, 4);
    bind_buffer(0x90D2, buffers[1]);
    if (found) get_data(0x90D2, 0, answers * 4, found);
    const unsigned error = get_error();
    if (error || !found) {
        fprintf(stderr, "OpenGL error 0x%x\n", error);
        return 1;
    }
    return fwrite(found, 4, (size_t)answers, stdout) != (size_t)answers;
}
