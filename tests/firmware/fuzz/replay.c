// Runs a fuzz target over the files of the kept corpus, where there is no libFuzzer: usage: replay FILE…
#include <stdio.h>

#include "fuzz.h"

int main(int count, char **paths)
{
    static uint8_t data[1 << 16];
    for (int i = 1; i < count; i++) {
        FILE *file = fopen(paths[i], "rb");
        if (!file) {
            perror(paths[i]);
            return 1;
        }
        size_t size = fread(data, 1, sizeof data, file);
        fclose(file);
        fprintf(stderr, "%s\n", paths[i]); // the last named file is the one that failed
        LLVMFuzzerTestOneInput(data, size);
    }
    printf("%d inputs\n", count - 1);
    return count < 2;
}
