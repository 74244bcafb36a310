/* What exported C takes of string.h, on WebAssembly without a C library. */
#ifndef WEB_STRING_H
#define WEB_STRING_H
#include <stddef.h>
#define memcpy __builtin_memcpy /* each is one instruction (-mbulk-memory) */
#define memmove __builtin_memmove
#define memset __builtin_memset
#endif
