/* gpu.h: compute shaders without a window, by EGL: OpenGL ES 3.1, or OpenGL 4.3. gpu.c has it.
 *
 *     gpu device;
 *     char error[512];
 *     if (!gpu_open(&device, 0, error, sizeof error)) { puts(error); return 1; }
 *     GLuint program = gpu_program(&device, texts, 3, "shader.glsl", error, sizeof error);
 *     GLuint buffer = gpu_buffer(0, words, bytes);            bound to storage buffer 0
 *     ... glUseProgram, uniforms, glDispatchCompute ...
 *     gpu_read(buffer, words, bytes);
 *     gpu_close(&device);
 *
 * Functions that return int or GLuint give 0 on failure, and one line in `error`. Link EGL and
 * GLESv2, which call into whichever context is current. Without a GPU Mesa's llvmpipe does it.
 */
#ifndef GPU_H
#define GPU_H

#include <EGL/egl.h>
#include <GLES3/gl31.h>
#include <stddef.h>

typedef struct gpu {
    EGLDisplay display;
    EGLContext context;
    int desktop;            /* OpenGL, not ES */
    char name[256];         /* of the device and its driver */
} gpu;

/* The first of: a display without surfaces, each device of EGL, the default display. */
int gpu_open(gpu *device, int desktop, char *error, size_t error_size);
void gpu_close(gpu *device);

/* Texts are joined behind the line of #version. `path` is what the message begins with. */
GLuint gpu_program(const gpu *device, const char *const *texts, int count, const char *path,
                   char *error, size_t error_size);

/* The same of SPIR-V, with `main` as its entry: OpenGL with ARB_gl_spirv. */
GLuint gpu_program_spirv(const void *words, size_t bytes, const char *path, char *error,
                         size_t error_size);

/* data NULL: not set. 0 where the device has not that much memory. */
GLuint gpu_buffer(GLuint binding, const void *data, size_t bytes);
int gpu_read(GLuint buffer, void *data, size_t bytes);

#endif
