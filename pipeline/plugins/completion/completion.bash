_flowsculpt() {
    local IFS=$'\n' line
    local -a found
    mapfile -t found < <(_FLOWSCULPT_COMPLETE=bash "$1" "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
    COMPREPLY=()
    for line in "${found[@]}"; do
        if [[ $line == :files ]]; then
            compopt -o filenames
            COMPREPLY+=($(compgen -f -- "$([[ $2 == = ]] || printf %s "$2")"))
        else
            COMPREPLY+=("${line%%$'\t'*}")
        fi
    done
}
complete -F _flowsculpt flowsculpt
