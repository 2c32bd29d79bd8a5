/* A table names the doubles of a struct in order, X(name, count): Python reads the names, and fills or views them
 * (double_table.py). */
#ifndef FMFTS_DOUBLE_TABLE_H
#define FMFTS_DOUBLE_TABLE_H

#define FMFTS_MEMBER(name, count) double name[count];
#define FMFTS_STRUCT(type, TABLE)                                                                                      \
    typedef struct {                                                                                                   \
        TABLE(FMFTS_MEMBER)                                                                                            \
    } type;

#endif
