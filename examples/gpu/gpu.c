/* gpu.c: see gpu.h. */
#include "gpu.h"

#include "../common/image.h"

#include <EGL/eglext.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define GPU_DEVICES_MAX 16
#define GPU_TEXTS_MAX 8
#define GPU_SPIRV 0x9551            /* GL_SHADER_BINARY_FORMAT_SPIR_V */

/* ---- contexts ---- */

static int gpu_start(gpu *device, EGLDisplay display)
{
    const EGLint version[] = { EGL_CONTEXT_MAJOR_VERSION, device->desktop ? 4 : 3,
                               EGL_CONTEXT_MINOR_VERSION, device->desktop ? 3 : 1, EGL_NONE };

    if (display == EGL_NO_DISPLAY || !eglInitialize(display, NULL, NULL))
        return 0;
    device->display = display;
    device->context = EGL_NO_CONTEXT;
    if (eglBindAPI(device->desktop ? EGL_OPENGL_API : EGL_OPENGL_ES_API))
        device->context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, version);
    if (device->context != EGL_NO_CONTEXT
        && eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, device->context))
        return 1;
    gpu_close(device);
    return 0;
}

/* EGL_EXT_platform_device: drivers that have no displays without surfaces, such as NVIDIA's. */
static int gpu_start_device(gpu *device)
{
    PFNEGLQUERYDEVICESEXTPROC query =
        (PFNEGLQUERYDEVICESEXTPROC)eglGetProcAddress("eglQueryDevicesEXT");
    EGLDeviceEXT devices[GPU_DEVICES_MAX];
    EGLint count = 0, i;

    if (!query || !query(GPU_DEVICES_MAX, devices, &count))
        return 0;
    for (i = 0; i < count; i++)
        if (gpu_start(device, eglGetPlatformDisplay(EGL_PLATFORM_DEVICE_EXT, devices[i], NULL)))
            return 1;
    return 0;
}

int gpu_open(gpu *device, int desktop, char *error, size_t error_size)
{
    device->desktop = desktop;
    if (!gpu_start(device, eglGetPlatformDisplay(EGL_PLATFORM_SURFACELESS_MESA,
                                                 EGL_DEFAULT_DISPLAY, NULL))
        && !gpu_start_device(device) && !gpu_start(device, eglGetDisplay(EGL_DEFAULT_DISPLAY)))
        return image_fail(error, error_size, desktop ? "OpenGL 4.3" : "OpenGL ES 3.1",
                          "no driver here has it, and so no compute shaders");
    snprintf(device->name, sizeof device->name, "%s, %s", (const char *)glGetString(GL_RENDERER),
             (const char *)glGetString(GL_VERSION));
    return 1;
}

void gpu_close(gpu *device)
{
    eglMakeCurrent(device->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    if (device->context != EGL_NO_CONTEXT)
        eglDestroyContext(device->display, device->context);
    eglTerminate(device->display);
    device->context = EGL_NO_CONTEXT;
}

/* ---- programs ---- */

/* The first line of what a compiler says. */
static int gpu_fail(GLuint shader, GLuint program, const char *path, char *error,
                    size_t error_size)
{
    char log[256] = "";

    if (program)
        glGetProgramInfoLog(program, (GLsizei)sizeof log, NULL, log);
    else
        glGetShaderInfoLog(shader, (GLsizei)sizeof log, NULL, log);
    log[strcspn(log, "\n")] = '\0';
    image_fail(error, error_size, path, "%s", log[0] ? log : "is refused by the driver");
    glDeleteShader(shader);
    glDeleteProgram(program);
    return 0;
}

/* Links what has been compiled. */
static GLuint gpu_link(GLuint shader, const char *path, char *error, size_t error_size)
{
    GLint good = 0;
    GLuint program;

    glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (!good)
        return (GLuint)gpu_fail(shader, 0, path, error, error_size);
    program = glCreateProgram();
    glAttachShader(program, shader);
    glLinkProgram(program);
    glGetProgramiv(program, GL_LINK_STATUS, &good);
    if (!good)
        return (GLuint)gpu_fail(shader, program, path, error, error_size);
    glDeleteShader(shader);
    return program;
}

GLuint gpu_program(const gpu *device, const char *const *texts, int count, const char *path,
                   char *error, size_t error_size)
{
    const char *all[GPU_TEXTS_MAX + 1];
    const GLuint shader = glCreateShader(GL_COMPUTE_SHADER);
    int i;

    all[0] = device->desktop ? "#version 430\n" : "#version 310 es\n"
             "#ifdef GL_EXT_gpu_shader5\n#extension GL_EXT_gpu_shader5 : enable\n"
             "#define ENVSAMP_PRECISE precise\n#endif\n"
             "precision highp float;\nprecision highp int;\n";
    for (i = 0; i < count && i < GPU_TEXTS_MAX; i++)
        all[i + 1] = texts[i];
    glShaderSource(shader, i + 1, all, NULL);
    glCompileShader(shader);
    return gpu_link(shader, path, error, error_size);
}

GLuint gpu_program_spirv(const void *words, size_t bytes, const char *path, char *error,
                         size_t error_size)
{
    typedef void (GL_APIENTRYP specialize_fn)(GLuint, const char *, GLuint, const GLuint *,
                                              const GLuint *);
    const specialize_fn specialize = (specialize_fn)eglGetProcAddress("glSpecializeShaderARB");
    const GLuint shader = glCreateShader(GL_COMPUTE_SHADER);

    glShaderBinary(1, &shader, GPU_SPIRV, words, (GLsizei)bytes);
    if (!specialize || glGetError() != GL_NO_ERROR)
        return (GLuint)gpu_fail(shader, 0, path, error, error_size);
    specialize(shader, "main", 0, NULL, NULL);
    return gpu_link(shader, path, error, error_size);
}

/* ---- buffers ---- */

GLuint gpu_buffer(GLuint binding, const void *data, size_t bytes)
{
    GLint64 most = 0;
    GLuint buffer = 0;

    glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &most);
    if (bytes > (size_t)most)
        return 0;
    while (glGetError() != GL_NO_ERROR)
        ;
    glGenBuffers(1, &buffer);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer);
    glBufferData(GL_SHADER_STORAGE_BUFFER, (GLsizeiptr)bytes, data, GL_STATIC_DRAW);
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, binding, buffer);
    if (glGetError() == GL_NO_ERROR)
        return buffer;
    glDeleteBuffers(1, &buffer);
    return 0;
}

int gpu_read(GLuint buffer, void *data, size_t bytes)
{
    const void *mapped;

    glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT | GL_SHADER_STORAGE_BARRIER_BIT);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, buffer);
    mapped = glMapBufferRange(GL_SHADER_STORAGE_BUFFER, 0, (GLsizeiptr)bytes, GL_MAP_READ_BIT);
    if (mapped)
        memcpy(data, mapped, bytes);
    return mapped && glUnmapBuffer(GL_SHADER_STORAGE_BUFFER);
}
