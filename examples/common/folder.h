/* folder.h: MAKE_FOLDER(path), which is fine where there is one already. */
#ifndef FOLDER_H
#define FOLDER_H

#ifdef _WIN32
#include <direct.h>
#define MAKE_FOLDER(path) _mkdir(path)
#else
#include <sys/stat.h>
#include <sys/types.h>
#define MAKE_FOLDER(path) mkdir(path, 0777)
#endif

#endif
